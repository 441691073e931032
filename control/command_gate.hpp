// The one gate: only here a SafeCommand is made. Control loop, step world. It always yields one:
// the request, scaled along its path into the velocity and acceleration limits, or the mode's
// fallback (slow down along the path, then stand still), with the reason. Positions are the
// integral of the limited velocities, so that set-points never jump. Units: rad, m, s, Nm.
#pragma once
#include <memory>

#include "core/model/robot_model.hpp"
#include "core/model/wheel_kinematics.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/command.hpp"
#include "core/types/mode.hpp"

namespace wb {

class CommandGate {
 public:
  explicit CommandGate(std::shared_ptr<const RobotModel> model);

  // Starts from standing still at the measured posture; call when the drives become active. q:
  // joints() entries.
  void reset(const double* q) RT_SAFE;

  // dt_s: time since the last call. Only Mode::kActive lets motion through; kIdle gives the empty
  // command. Requests older than kMemory_ns before `now` are refused.
  SafeCommand step(const Command& request, TimeNs now, double dt_s, Mode mode) RT_SAFE;

  const std::array<double, kMaxJoints>& positions() const {
    return position_;
  }  // where the set-points stand

  static constexpr TimeNs kMemory_ns = 5'000'000;

 private:
  void limit_joints(std::array<double, kMaxJoints>& velocity, double dt_s, bool& scaled,
                    bool& clipped) RT_SAFE;
  void limit_base(const WheelKinematics::Twist& velocity, double dt_s, bool& scaled) RT_SAFE;

  std::shared_ptr<const RobotModel> model_;
  std::array<double, kMaxJoints> position_{};
  std::array<double, kMaxJoints> velocity_{};
  WheelKinematics kinematics_;
  WheelKinematics::Twist base_velocity_{};
  std::array<JointCommand, kMaxJoints>
      last_good_{};  // of the last request that was made of numbers
  GripperCommand last_grip_{};
};

}  // namespace wb
