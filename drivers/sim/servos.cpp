#include "drivers/sim/servos.hpp"

#include <algorithm>
#include <cmath>

#include "core/model/urdf_file.hpp"

namespace wb::sim {
namespace {

Drive make_drive(const urdf::ModelInterface& urdf, const mjModel& model, const std::string& name) {
  const int joint = mj_name2id(&model, mjOBJ_JOINT, name.c_str());
  const int motor = mj_name2id(&model, mjOBJ_ACTUATOR, name.c_str());
  if (joint < 0 || motor < 0)
    throw config::ConfigError("the simulated model lacks the joint '" + name + "'");
  const urdf::Joint& description = *urdf.getJoint(name);
  Drive drive{name, model.jnt_qposadr[joint], model.jnt_dofadr[joint], motor};
  if (description.type != urdf::Joint::CONTINUOUS) {
    drive.lower = description.limits->lower;
    drive.upper = description.limits->upper;
  }
  drive.velocity_max = description.limits->velocity;
  drive.effort_max = description.limits->effort;
  return drive;
}

bool finite(const wb_commands& commands, std::size_t joints) noexcept {
  bool ok = std::isfinite(commands.gripper.opening) && std::isfinite(commands.gripper.force);
  for (std::size_t i = 0; i < joints; ++i) {
    const auto& c = commands.joints[i];
    ok = ok && std::isfinite(c.position + c.velocity + c.effort + c.stiffness + c.damping);
  }
  return ok;
}

}  // namespace

Servos::Servos(const PluginConfig& config, const mjModel& model, const mjData& data)
    : wheel_damping_(config.sim.wheels.servo_damping),
      gripper_(config.sim.gripper),
      step_s_(to_seconds(config.sim.step_ns)) {
  const urdf::ModelInterfaceSharedPtr urdf = read_urdf(config.robot.urdf);
  for (std::size_t i = 0; i < config.robot.joints.size(); ++i) {
    drives_.push_back(make_drive(*urdf, model, config.robot.joints[i].name));
    const JointSimConfig& sim = config.sim.joints[i];
    fallbacks_.push_back({sim.hold_stiffness, sim.hold_damping, sim.damped_damping});
  }
  arm_joints_ = static_cast<int>(drives_.size());
  for (const std::string& wheel : config.robot.base.wheels) {
    drives_.push_back(make_drive(*urdf, model, wheel));
    const WheelSimConfig& sim = config.sim.wheels;
    fallbacks_.push_back({sim.brake_stiffness, sim.brake_damping, sim.brake_damping});
  }
  for (const std::string& finger : config.robot.fingers)
    fingers_.push_back(make_drive(*urdf, model, finger));
  finger_target_m_ = finger_reference_m_ = fingers_.empty() ? 0.0 : data.qpos[fingers_[0].q];
  finger_force_n_ = gripper_.force_max_n;
}

double Servos::gripper_opening(const mjData& data) const noexcept {
  double sum = 0;
  for (const Drive& finger : fingers_) sum += data.qpos[finger.q];
  return sum;
}

double Servos::gripper_force(const mjData& data) const noexcept {
  double sum = 0;
  for (const Drive& finger : fingers_) sum -= data.ctrl[finger.u];
  return fingers_.empty() ? 0.0 : sum / static_cast<double>(fingers_.size());
}

void Servos::activate(TimeNs timeout_ns, const wb_timeout_action* actions) noexcept {
  // The brakes stay on until the first write, and the time-out counts from there.
  timeout_ns_ = timeout_ns;
  std::copy_n(actions, drives_.size(), actions_);
  active_ = true;
}

void Servos::deactivate() noexcept {
  active_ = false;
  authority_ = Authority::kBrakes;
}

wb_status Servos::write(const wb_commands& commands, TimeNs now_ns) noexcept {
  if (!active_) return WB_BAD_STATE;
  if (timed_out()) return WB_TIMED_OUT;
  if (!finite(commands, drives_.size())) return WB_ERROR;
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    const std::uint32_t own = is_wheel(i) ? WB_CMD_VELOCITY : WB_CMD_IMPEDANCE;
    if (commands.joints[i].kind != own && commands.joints[i].kind != WB_CMD_NONE) return WB_ERROR;
  }
  commands_ = commands;
  last_write_ns_ = now_ns;
  authority_ = Authority::kCommands;
  const double stroke = fingers_.empty() ? 0.0 : fingers_[0].upper;
  finger_target_m_ = std::clamp(0.5 * commands.gripper.opening, 0.0, stroke);
  finger_force_n_ = std::clamp(commands.gripper.force, 0.0, gripper_.force_max_n);
  return WB_OK;
}

void Servos::stop() noexcept {
  if (active_) authority_ = Authority::kTimeOut;
}

double Servos::commanded_effort(std::size_t i, const mjData& data) const noexcept {
  const Drive& drive = drives_[i];
  const auto& c = commands_.joints[i];
  const double velocity = std::clamp(c.velocity, -drive.velocity_max, drive.velocity_max);
  if (c.kind == WB_CMD_VELOCITY) return wheel_damping_ * (velocity - data.qvel[drive.v]) + c.effort;
  const double position =
      drive.lower < drive.upper ? std::clamp(c.position, drive.lower, drive.upper) : c.position;
  return c.stiffness * (position - data.qpos[drive.q]) +
         c.damping * (velocity - data.qvel[drive.v]) + c.effort;
}

double Servos::fallback_effort(std::size_t i, const mjData& data) noexcept {
  const Drive& drive = drives_[i];
  Fallback& f = fallbacks_[i];
  // Gravity is compensated in every action, so that a halted arm does not drop.
  const double gravity = is_wheel(i) ? 0.0 : data.qfrc_bias[drive.v];
  if (authority_ != Authority::kBrakes && actions_[i] == WB_TIMEOUT_DAMPED) {
    f.holding = false;
    return gravity - f.damped_damping * data.qvel[drive.v];
  }
  if (!f.holding) {
    f.holding = true;
    f.position = data.qpos[drive.q];
  }
  return gravity + f.hold_stiffness * (f.position - data.qpos[drive.q]) -
         f.hold_damping * data.qvel[drive.v];
}

void Servos::apply_gripper(mjData& data) noexcept {
  // The fingers mirror each other, so their mean is the gripper's position.
  const double position = 0.5 * gripper_opening(data);
  const double travel = gripper_.speed_mps * step_s_;
  finger_reference_m_ += std::clamp(finger_target_m_ - finger_reference_m_, -travel, travel);
  // The reference never leads by more than the force needs, so that a gripper that was blocked
  // answers at once.
  const double lead = finger_force_n_ / gripper_.servo_npm;
  finger_reference_m_ = std::clamp(finger_reference_m_, position - lead, position + lead);
  for (const Drive& finger : fingers_) {
    const double force = gripper_.servo_npm * (finger_reference_m_ - data.qpos[finger.q]) -
                         gripper_.servo_nspm * data.qvel[finger.v];
    data.ctrl[finger.u] = std::clamp(force, -finger_force_n_, finger_force_n_);
  }
}

void Servos::apply(mjData& data, TimeNs now_ns) noexcept {
  if (authority_ == Authority::kCommands && now_ns - last_write_ns_ > timeout_ns_)
    authority_ = Authority::kTimeOut;
  for (std::size_t i = 0; i < drives_.size(); ++i) {
    double effort = 0;
    if (authority_ == Authority::kCommands && commands_.joints[i].kind != WB_CMD_NONE) {
      fallbacks_[i].holding = false;
      effort = commanded_effort(i, data);
    } else {
      effort = fallback_effort(i, data);
    }
    data.ctrl[drives_[i].u] = std::clamp(effort, -drives_[i].effort_max, drives_[i].effort_max);
  }
  if (fingers_.size() == 2) apply_gripper(data);
}

}  // namespace wb::sim
