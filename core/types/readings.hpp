// What one control tick reads from the drivers, in the robot's joint order (robot.yaml). Trivially
// copyable.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/time.hpp"

namespace wb {

struct JointReading {
  double position = 0;  // rad or m
  double velocity = 0;  // rad/s or m/s
  double torque = 0;    // Nm or N, as the drive estimates it
  TimeNs age_ns = 0;    // since the drive measured it
  bool valid = false;
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
  bool driver_fault = false;  // a plugin reported an error on this read
};

}  // namespace wb
