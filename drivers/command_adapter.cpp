#include "drivers/command_adapter.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "core/config/config.hpp"

namespace wb {
namespace {

std::string kinds(std::uint32_t mask) {
  std::string out;
  for (int k = WB_CMD_IMPEDANCE; k <= WB_CMD_TORQUE; ++k) {
    if (mask & (1u << k))
      out += (out.empty() ? "" : ", ") + std::string(to_string(static_cast<wb_command_kind>(k)));
  }
  return out.empty() ? "nothing" : out;
}

}  // namespace

const char* to_string(wb_command_kind kind) {
  switch (kind) {
    case WB_CMD_NONE:
      return "none";
    case WB_CMD_IMPEDANCE:
      return "impedance";
    case WB_CMD_VELOCITY:
      return "velocity";
    case WB_CMD_POSITION:
      return "position";
    case WB_CMD_TORQUE:
      return "torque";
  }
  return nullptr;
}

CommandAdapter::CommandAdapter(const wb_joint_info& info, bool wheel, wb_command_kind wanted)
    : effort_max_(info.effort_max) {
  const auto supports = [&](wb_command_kind k) { return (info.command_kinds & (1u << k)) != 0; };
  const std::string has =
      "joint " + std::string(info.name) + " supports " + kinds(info.command_kinds);
  if (wheel) {
    if (!supports(WB_CMD_VELOCITY)) throw std::runtime_error(has + ", a wheel needs velocity");
    kind_ = WB_CMD_VELOCITY;
    return;
  }
  if (wanted != WB_CMD_NONE) {
    if (!supports(wanted))
      throw config::ConfigError(has + ", its driver's 'command' asks for " + to_string(wanted));
    kind_ = wanted;
    return;
  }
  for (const wb_command_kind k : {WB_CMD_IMPEDANCE, WB_CMD_POSITION, WB_CMD_TORQUE}) {
    if (kind_ == WB_CMD_NONE && supports(k)) kind_ = k;
  }
  if (kind_ == WB_CMD_NONE)
    throw std::runtime_error(has + ", the controller needs impedance, position or torque");
}

void CommandAdapter::adapt(const JointCommand& in, const JointReading& reading,
                           wb_commands& commands, int joint) const RT_SAFE {
  auto& out = commands.joints[joint];
  out = {};  // WB_CMD_NONE
  switch (kind_) {
    case WB_CMD_VELOCITY:
      if (in.kind != CommandKind::kVelocity) return;
      out.velocity = in.velocity;
      out.effort = in.torque;
      break;
    case WB_CMD_IMPEDANCE:
    case WB_CMD_POSITION:
      if (in.kind != CommandKind::kImpedance) return;
      out.position = in.position;
      out.velocity = in.velocity;
      out.effort = in.torque;
      if (kind_ == WB_CMD_IMPEDANCE) {
        out.stiffness = in.stiffness;
        out.damping = in.damping;
      }
      break;
    case WB_CMD_TORQUE: {
      if (in.kind != CommandKind::kImpedance || !reading.valid) return;
      const double effort = in.stiffness * (in.position - reading.position) +
                            in.damping * (in.velocity - reading.velocity) + in.torque;
      if (!std::isfinite(effort)) return;
      out.effort = std::clamp(effort, -effort_max_, effort_max_);
      break;
    }
    case WB_CMD_NONE:
      return;
  }
  out.kind = kind_;
}

}  // namespace wb
