#include "mapping/robot_filter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace wb {
namespace {

struct Rectangle {  // pixels, upper ends not included
  int u0, u1, v0, v1;
};

// Smallest and largest image coordinate that a sphere can cover: that of its bounding box, cut at
// the nearest depth that yields points. x / z is monotone in either over the box, so that its
// corners bound it.
void extend(double x, double radius, double z_near, double z_far, double focal, double centre,
            double& low, double& high) {
  for (const double z : {z_near, z_far}) {
    low = std::min(low, focal * (x - radius) / z + centre);
    high = std::max(high, focal * (x + radius) / z + centre);
  }
}

Rectangle bounds(const Eigen::Vector3d& p0, const Eigen::Vector3d& p1, double radius,
                 const CameraIntrinsics& camera) {
  const double largest = std::max(camera.width, camera.height) + 1.0;
  double u_low = largest, u_high = -1, v_low = largest, v_high = -1;
  // Both ends cut at the same depths: the hull of the two boxes holds the capsule.
  const double z_far = std::max(p0.z(), p1.z()) + radius;
  if (z_far <= camera.range_min_m) return {0, 0, 0, 0};
  const double z_near = std::max(std::min(p0.z(), p1.z()) - radius, camera.range_min_m);
  for (const Eigen::Vector3d& p : {p0, p1}) {
    extend(p.x(), radius, z_near, z_far, camera.fx, camera.cx, u_low, u_high);
    extend(p.y(), radius, z_near, z_far, camera.fy, camera.cy, v_low, v_high);
  }
  const auto pixel = [](double value, int size) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(size)));
  };
  return {pixel(std::floor(u_low), camera.width), pixel(std::ceil(u_high), camera.width),
          pixel(std::floor(v_low), camera.height), pixel(std::ceil(v_high), camera.height)};
}

}  // namespace

RobotFilter::RobotFilter(const RobotModel& model, double padding_m) {
  for (const Sphere& s : model.spheres()) {
    bodies_.push_back({s.body, s.centre, s.centre, s.radius + padding_m});
  }
  for (const Capsule& c : model.capsules()) {
    bodies_.push_back({c.body, c.p0, c.p1, c.radius + padding_m});
  }
}

int RobotFilter::mark(const DepthFrame& frame, const Eigen::Isometry3d& X_WC,
                      const RobotModel::Data& data, std::uint8_t* on_robot) const RT_SAFE {
  const CameraIntrinsics& camera = frame.intrinsics;
  const int pixels = camera.width * camera.height;
  std::fill_n(on_robot, pixels, std::uint8_t{0});
  const Eigen::Isometry3d X_CW = X_WC.inverse();
  const auto x_first = static_cast<float>((0.5 - camera.cx) / camera.fx);
  const auto x_spacing = static_cast<float>(1.0 / camera.fx);
  for (const Body& body : bodies_) {
    const Eigen::Isometry3d X_CL = X_CW * data.X_WL[body.body];
    const Eigen::Vector3d a = X_CL * body.p0, b = X_CL * body.p1;
    const Rectangle r = bounds(a, b, body.radius, camera);
    const Eigen::Vector3f p0 = a.cast<float>(), axis = (b - a).cast<float>();
    const float inverse = 1.0f / std::max(axis.squaredNorm(), std::numeric_limits<float>::min());
    const auto radius_squared = static_cast<float>(body.radius * body.radius);
    for (int v = r.v0; v < r.v1; ++v) {  // no branches within: several pixels to an instruction
      const auto y_slope = static_cast<float>((v + 0.5 - camera.cy) / camera.fy);
      for (int u = r.u0; u < r.u1; ++u) {
        const float x_slope = x_first + static_cast<float>(u) * x_spacing;
        const int i = v * camera.width + u;
        const float z = frame.depth[i];
        // Distance to the segment; comparisons are false where there is no return (z infinite).
        const float dx = x_slope * z - p0.x(), dy = y_slope * z - p0.y(), dz = z - p0.z();
        const float along = (dx * axis.x() + dy * axis.y() + dz * axis.z()) * inverse;
        const float s = std::min(std::max(along, 0.0f), 1.0f);
        const float ex = dx - s * axis.x(), ey = dy - s * axis.y(), ez = dz - s * axis.z();
        on_robot[i] |= ex * ex + ey * ey + ez * ez <= radius_squared;
      }
    }
  }
  int count = 0;
  for (int i = 0; i < pixels; ++i) count += on_robot[i];
  return count;
}

}  // namespace wb
