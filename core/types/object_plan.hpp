// The object-centric planner's output: how the object moves, where to grasp it, and the hand's path
// while it opens. Frames: W odometry, E hand, O the object's unit. Source: Mittal et al. 2022, Sec.
// III.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/name.hpp"
#include "core/types/pose.hpp"
#include "core/types/reference.hpp"
#include "core/types/time.hpp"

namespace wb {

enum class JointKind : std::uint8_t { kPrismatic, kRevolute };

struct ArticulationEstimate {
  JointKind kind = JointKind::kPrismatic;
  std::array<double, 3> axis_origin{};  // a point of the axis, in W [m]
  std::array<double, 3> axis{1, 0, 0};  // unit, in W; positive joint values open
  double value = 0;                     // present joint value, m or rad
  double range = 0;                     // largest joint value, m or rad
};

struct ObjectPlan {
  std::uint64_t seq = 0;
  TimeNs t_ns = 0;
  Name object;
  bool measured = false;  // false: coarse prior; true: measured from the shoulder camera
  ArticulationEstimate articulation;
  Pose X_WG;  // handle: origin at the bar's centre, x along the bar, z into the front (approach)
  double handle_radius_m = 0;
  double handle_length_m = 0;
  std::array<MaskBox, kMaxMasks> masks{};  // carcass (fixed) and moving part (at the present value)

  // Keyframes of E from grasp to fully open: X_WE at joint values keyframe_value[i], ascending,
  // first at the present value.
  int keyframe_count = 0;
  std::array<Pose, kMaxKeyframes> keyframes{};
  std::array<double, kMaxKeyframes> keyframe_value{};
};

}  // namespace wb
