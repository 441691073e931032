// The estimator's output: where the robot is at t_ns. Trivially copyable, frames W (odometry), B
// (base), E (hand).
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/mode.hpp"
#include "core/types/pose.hpp"
#include "core/types/time.hpp"

namespace wb {

struct RobotState {
  std::uint64_t seq = 0;
  TimeNs t_ns = 0;
  Mode mode = Mode::kIdle;
  Phase phase = Phase::kNone;
  int joint_count = 0;
  std::array<double, 3> base{};           // x, y [m], yaw [rad, continuous], X_WB on the floor
  std::array<double, 3> base_velocity{};  // forward, sideways [m/s], yaw rate [rad/s], in B
  std::array<double, kMaxJoints> q{};     // rad or m
  std::array<double, kMaxJoints> dq{};
  std::array<double, kMaxJoints> tau{};
  std::array<double, kMaxJoints>
      q_command{};  // where the servos' set-points stand; the MPC plans from these
  std::array<double, 6>
      wrench{};                  // environment on hand at E in E [N, Nm], hand's own weight removed
  std::array<double, 3> gyro{};  // rad/s in B, as read
  std::array<double, 3> acceleration{};  // m/s^2 in B, specific force, as read
  double gripper_opening_m = 0;
  double gripper_force_n = 0;

  Eigen::Isometry3d X_WB() const { return planar_isometry(base[0], base[1], base[2]); }
};

}  // namespace wb
