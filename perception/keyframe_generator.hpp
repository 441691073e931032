// Hand poses along the path that a joint allows: about its axis (revolute) or along it (prismatic).
// Perception job. Frames: W odometry, G handle (x along the bar, z into the front), E hand (z
// approaches, y is the fingers' stroke). SI. Source: Mittal et al. 2022, Sec. III-C.
#pragma once
#include "core/types/object_plan.hpp"

namespace wb {

class KeyframeGenerator {
 public:
  // x_E_W: which way the hand's x axis should rather point; the grasp is symmetric under half a
  // turn about the approach axis.
  explicit KeyframeGenerator(const Eigen::Vector3d& x_E_W) : x_E_W_(x_E_W) {}

  // Fills plan.keyframes from plan.articulation and plan.X_WG: evenly spaced joint values from the
  // present one to the range.
  void generate(ObjectPlan& plan) const;

  // X_WE at a joint value, for a hand that holds X_WE0 at the articulation's present value.
  static Eigen::Isometry3d pose_at(const ArticulationEstimate& articulation,
                                   const Eigen::Isometry3d& X_WE0, double value);

  static constexpr int kKeyframes = 33;

 private:
  Eigen::Vector3d x_E_W_;
};

}  // namespace wb
