// The drives inside the plant: joint impedance, wheel velocity and gripper servos at the physics'
// rate, brakes, and the time-out. Step world. Torques are those of the URDF's joints, clipped to
// their effort. Time is the plant's own, from 0.
#pragma once
#include <mujoco/mujoco.h>

#include <vector>

#include "drivers/driver.h"
#include "drivers/sim/sim_config.hpp"

namespace wb::sim {

// One actuated joint in MuJoCo's arrays, with its limits (equal positions: none).
struct Drive {
  std::string name;
  int q = 0, v = 0, u = 0;
  double lower = 0, upper = 0, velocity_max = 0, effort_max = 0;
};

class Servos {
 public:
  Servos(const PluginConfig& config, const mjModel& model, const mjData& data);

  // Arm joints in robot.yaml's order, then the wheels: the order of the driver's description.
  const std::vector<Drive>& drives() const { return drives_; }
  int arm_joints() const { return arm_joints_; }
  double gripper_opening(const mjData& data) const noexcept;  // m, total
  double gripper_force(const mjData& data) const noexcept;    // N per finger, positive closes

  void activate(TimeNs timeout_ns, const wb_timeout_action* actions) noexcept;
  void deactivate() noexcept;
  wb_status write(const wb_commands& commands, TimeNs now_ns) noexcept;
  void stop() noexcept;
  bool active() const noexcept { return active_; }
  bool timed_out() const noexcept { return authority_ == Authority::kTimeOut; }
  bool following() const noexcept { return authority_ == Authority::kCommands; }

  // Sets the motors' torques for the next physics step from the state now.
  void apply(mjData& data, TimeNs now_ns) noexcept;

 private:
  enum class Authority { kBrakes, kCommands, kTimeOut };
  struct Fallback {
    double hold_stiffness = 0, hold_damping = 0, damped_damping = 0;
    bool holding = false;
    double position = 0;  // where it holds
  };

  bool is_wheel(std::size_t i) const noexcept { return static_cast<int>(i) >= arm_joints_; }
  double fallback_effort(std::size_t i, const mjData& data) noexcept;
  double commanded_effort(std::size_t i, const mjData& data) const noexcept;
  void apply_gripper(mjData& data) noexcept;

  std::vector<Drive> drives_;
  std::vector<Drive> fingers_;
  std::vector<Fallback> fallbacks_;
  int arm_joints_ = 0;
  double wheel_damping_ = 0;
  GripperSimConfig gripper_;
  double step_s_ = 0;

  bool active_ = false;
  Authority authority_ = Authority::kBrakes;
  TimeNs timeout_ns_ = 0;
  TimeNs last_write_ns_ = 0;
  wb_commands commands_{};
  wb_timeout_action actions_[WB_DRIVER_MAX_JOINTS] = {};
  double finger_target_m_ = 0, finger_force_n_ = 0;
  double finger_reference_m_ = 0;  // moves to the target at the gripper's speed
};

}  // namespace wb::sim
