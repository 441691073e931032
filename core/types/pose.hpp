// Pose as it travels through the buffers: position p [m] and unit quaternion (x y z w), trivially
// copyable. X_AB maps coordinates in B to coordinates in A (monogram notation).
#pragma once
#include <Eigen/Geometry>
#include <array>

namespace wb {

struct Pose {
  std::array<double, 3> p{0, 0, 0};
  std::array<double, 4> q{0, 0, 0, 1};  // x y z w

  Eigen::Vector3d position() const { return Eigen::Vector3d(p[0], p[1], p[2]); }
  Eigen::Quaterniond rotation() const { return Eigen::Quaterniond(q[3], q[0], q[1], q[2]); }
  Eigen::Isometry3d isometry() const {
    Eigen::Isometry3d x = Eigen::Isometry3d::Identity();
    x.linear() = rotation().toRotationMatrix();
    x.translation() = position();
    return x;
  }

  static Pose from(const Eigen::Vector3d& p, const Eigen::Quaterniond& q) {
    return Pose{{p.x(), p.y(), p.z()}, {q.x(), q.y(), q.z(), q.w()}};
  }
  static Pose from(const Eigen::Isometry3d& x) {
    return from(x.translation(), Eigen::Quaterniond(x.linear()).normalized());
  }
};

// Pose of a body on the floor: x, y [m], yaw [rad].
inline Eigen::Isometry3d planar_isometry(double x, double y, double yaw) {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  out.translation() << x, y, 0.0;
  return out;
}

}  // namespace wb
