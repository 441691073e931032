#include "drivers/dds/low_level/command_filter.hpp"

#include <cmath>

namespace wb::dds {

const char* refuse(const msg::JointCommands& c, const wb_description& robot, TimeNs now_ns,
                   TimeNs memory_ns) noexcept {
  if (c.joint_count_ != 0 && c.joint_count_ != robot.joint_count) return "wrong number of joints";
  if (c.valid_for_ns_ <= 0 || c.valid_for_ns_ > kValidForMaxNs) return "valid_for out of range";
  // Compared without a difference of two hostile numbers.
  if (c.stamp_ns_ > now_ns + kFutureNs) return "from the future";
  if (c.stamp_ns_ < 0 || (memory_ns > 0 && c.stamp_ns_ < now_ns - memory_ns)) return "too old";
  for (std::uint32_t i = 0; i < c.joint_count_; ++i) {
    if (c.kind_[i] > WB_CMD_TORQUE) return "unknown command kind";
    if (c.kind_[i] == WB_CMD_NONE) continue;
    if (!(robot.joints[i].command_kinds & (1u << c.kind_[i])))
      return "a joint does not take this kind of command";
    for (const double value :
         {c.position_[i], c.velocity_[i], c.effort_[i], c.stiffness_[i], c.damping_[i]}) {
      if (!std::isfinite(value)) return "not finite";
    }
    if (c.stiffness_[i] < 0 || c.damping_[i] < 0) return "negative gain";
  }
  if (c.has_gripper_) {
    if (!robot.has_gripper) return "there is no gripper";
    if (!std::isfinite(c.gripper_opening_) || !std::isfinite(c.gripper_force_)) return "not finite";
  }
  return nullptr;
}

void clip(const msg::JointCommands& c, const wb_description& robot, wb_commands& out) noexcept {
  out = {};
  out.t_ns = c.stamp_ns_;
  for (std::uint32_t i = 0; i < c.joint_count_; ++i) {
    if (c.kind_[i] == WB_CMD_NONE) continue;
    const wb_joint_info& limits = robot.joints[i];
    auto& joint = out.joints[i];
    const auto bound = [](double value, double low, double high) {
      return std::fmin(std::fmax(value, low), high);
    };
    joint.kind = c.kind_[i];
    joint.position = limits.position_min < limits.position_max
                         ? bound(c.position_[i], limits.position_min, limits.position_max)
                         : c.position_[i];
    joint.velocity = bound(c.velocity_[i], -limits.velocity_max, limits.velocity_max);
    joint.effort = bound(c.effort_[i], -limits.effort_max, limits.effort_max);
    joint.stiffness = c.stiffness_[i];
    joint.damping = c.damping_[i];
  }
  if (c.has_gripper_) {
    out.gripper.opening = c.gripper_opening_;
    out.gripper.force = c.gripper_force_;
  }
}

}  // namespace wb::dds
