// The Reference at one instant: what the keyframes ask of the end-effectors and of the base. Frame
// W, SI units. Step world: sampled once per node and solve, shared by all terms.
#pragma once
#include <Eigen/Geometry>

#include "core/types/reference.hpp"

namespace wb {

struct PoseSample {
  bool active = false;
  Eigen::Vector3d p_WE{0, 0, 0};
  Eigen::Matrix3d R_WE = Eigen::Matrix3d::Identity();
};

struct ReferenceSample {
  std::array<PoseSample, kMaxEndEffectors> ee;
  bool has_base = false;
  Eigen::Vector3d base{0, 0, 0};  // x, y [m], yaw [rad]

  bool finite() const;
};

// Between keyframes: linear position, spherical-linear rotation; before the first and after the
// last: held. Values that are not numbers, and quaternions of length zero, come out as NaN.
ReferenceSample sample(const Reference& reference, TimeNs t) noexcept;

}  // namespace wb
