// What the sequencer asks of the MPC: timed end-effector and base keyframes, twists, wrenches,
// posture, mask. Trivially copyable. Between keyframes: linear position, spherical-linear rotation;
// before the first and after the last: held. Frame W, SI; twists and wrenches linear over angular.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/pose.hpp"
#include "core/types/time.hpp"

namespace wb {

struct EndEffectorKeyframe {
  TimeNs t_ns = 0;
  Pose X_WE;
};

// Hard: row . V_WE = rate, for the end-effector's twist V_WE about its own origin, in W.
struct VelocityConstraint {
  std::array<double, 6> row{};
  double rate = 0;
};

inline constexpr int kMaxVelocityConstraints = 6;

// What is asked of one end-effector.
struct EndEffectorReference {
  int count = 0;  // 0: no pose is asked for
  std::array<EndEffectorKeyframe, kMaxKeyframes> keyframes{};
  double position_scale = 1.0;  // multiplies the configured weight
  double orientation_scale = 1.0;
  bool twist_active = false;
  std::array<double, 6> twist_W{};  // wanted V_WE, m/s and rad/s
  bool wrench_active = false;
  std::array<double, 6> wrench_W{};  // environment on the end-effector at its origin, N and Nm
  int constraint_count = 0;
  std::array<VelocityConstraint, kMaxVelocityConstraints> constraints{};
};

struct BaseKeyframe {
  TimeNs t_ns = 0;
  std::array<double, 3> base{};  // x, y [m], yaw [rad, continuous]
};

// Box that the masked spheres may enter: the unit being opened (DEFINITIONS.md, "Masked unit").
struct MaskBox {
  bool active = false;
  Pose X_WM;                            // box centre and axes
  std::array<double, 3> half_extent{};  // m
};

inline constexpr int kMaxMasks = 2;  // the unit's carcass, and its moving part

struct Reference {
  std::uint64_t seq = 0;
  TimeNs t_ns = 0;

  // 0: E, the hand; then robot.yaml's more_end_effectors in their order.
  std::array<EndEffectorReference, kMaxEndEffectors> ee{};

  bool base_goal_active = false;      // ask the base planner for a route to base_goal
  std::array<double, 3> base_goal{};  // x, y [m], yaw [rad] in W
  int base_count =
      0;  // route, filled by the MPC loop from base_goal (or by the sequencer); 0: none
  std::array<BaseKeyframe, kMaxKeyframes> base{};
  double base_scale = 1.0;

  int joint_count = 0;
  std::array<double, kMaxJoints> posture{};  // preferred joint positions, rad or m
  double posture_scale = 1.0;

  double speed_scale = 1.0;  // (0, 1]: multiplies velocity limits
  std::array<MaskBox, kMaxMasks> masks{};
};

}  // namespace wb
