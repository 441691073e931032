// What one control tick reads from the drivers, in the robot's joint order (robot.yaml). Trivially
// copyable.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/time.hpp"

namespace wb {

// What a joint's drive is doing, whatever was asked of it.
enum class JointStatus : std::uint8_t {
  kUnknown,    // not a state that its driver can name: not safe
  kDisabled,   // no power, or brake on
  kFollowing,  // follows commands
  kStopped,    // the driver's time-out action or a stop holds it, until the next activation
  kFault,      // the drive reports an error
  kLost,       // nothing heard from it for longer than its driver allows
};

struct JointReading {
  double position = 0;  // rad or m
  double velocity = 0;  // rad/s or m/s
  double torque = 0;    // Nm or N, as the drive estimates it
  TimeNs age_ns = 0;    // since the drive measured it
  bool valid = false;
  JointStatus status = JointStatus::kUnknown;
  std::uint32_t error_code = 0;  // the drive's own, 0: none
  double quality = 0;            // share of the last second's samples that came in time, 0 to 1
};

struct Readings {
  TimeNs t_ns = 0;
  int joint_count = 0;
  int wheel_count = 0;
  std::array<JointReading, kMaxJoints> joints{};
  std::array<JointReading, kMaxWheels> wheels{};
  std::array<double, 3> gyro{};          // rad/s, in B
  std::array<double, 3> acceleration{};  // m/s^2, specific force, in B
  bool imu_valid = false;
  std::array<double, 6>
      wrench{};  // force, torque of the environment on the hand, at E in E, hand's weight included
  bool wrench_valid = false;
  double gripper_opening_m = 0;  // total opening
  double gripper_force_n = 0;    // per finger
  bool gripper_valid = false;
  bool emergency_stop = false;
  // A plugin failed to read, to write or to activate, stopped its joints by itself, or a joint is
  // unknown, lost or in fault while active.
  bool driver_fault = false;
};

}  // namespace wb
