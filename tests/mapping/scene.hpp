// A room of boxes that the tests can both see (ray caster, z-depth) and measure (exact distance).
// Frame W [m]. The room itself is the inside of a box; capsules stand for the robot's own bodies,
// which only the camera sees.
#pragma once
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "core/model/robot_model.hpp"
#include "core/types/depth_frame.hpp"

namespace wb::test {

struct Box {
  Eigen::Vector3d low, high;
};

struct Tube {  // a sphere where p0 = p1
  Eigen::Vector3d p0, p1;
  double radius;
};

struct Scene {
  Box room;
  std::vector<Box> boxes;
  std::vector<Tube> robot;

  // Distance of a point of the free space to the nearest wall or box; floor and ceiling do not
  // count.
  double distance(const Eigen::Vector3d& p) const {
    double d = std::min((p - room.low).head<2>().minCoeff(), (room.high - p).head<2>().minCoeff());
    for (const Box& b : boxes) {
      d = std::min(d, (b.low - p).cwiseMax(p - b.high).cwiseMax(0.0).norm());
    }
    return d;
  }

  bool free(const Eigen::Vector3d& p) const {
    for (const Box& b : boxes) {
      if ((p - b.low).minCoeff() >= 0 && (b.high - p).minCoeff() >= 0) return false;
    }
    return (p - room.low).minCoeff() > 0 && (room.high - p).minCoeff() > 0;
  }

  // Ray parameter of the first surface met.
  double cast(const Eigen::Vector3d& from, const Eigen::Vector3d& d) const {
    double t = slab(room, from, d).second;
    for (const Box& b : boxes) {
      const auto [enter, leave] = slab(b, from, d);
      if (enter <= leave && enter > 0) t = std::min(t, enter);
    }
    for (const Tube& tube : robot) t = std::min(t, cast(tube, from, d));
    return t;
  }

 private:
  static std::pair<double, double> slab(const Box& b, const Eigen::Vector3d& from,
                                        const Eigen::Vector3d& d) {
    double enter = -std::numeric_limits<double>::infinity(), leave = -enter;
    for (int a = 0; a < 3; ++a) {
      const double t0 = (b.low[a] - from[a]) / d[a], t1 = (b.high[a] - from[a]) / d[a];
      enter = std::max(enter, std::min(t0, t1));
      leave = std::min(leave, std::max(t0, t1));
    }
    return {enter, leave};
  }

  // Marching by the distance to the tube (its exact distance function), up to 3 m of it.
  static double cast(const Tube& tube, const Eigen::Vector3d& from, const Eigen::Vector3d& d) {
    const double speed = d.norm();
    const Eigen::Vector3d axis = tube.p1 - tube.p0, centre = tube.p0 + 0.5 * axis - from;
    const double ball = tube.radius + 0.5 * axis.norm();
    if (centre.norm() > ball && (centre.dot(d) < 0 || centre.cross(d).norm() > ball * speed)) {
      return std::numeric_limits<double>::infinity();
    }
    double t = 0;
    for (int n = 0; n < 60 && t * speed < 3.0; ++n) {
      const Eigen::Vector3d r = from + t * d - tube.p0;
      const double s =
          axis.squaredNorm() > 0 ? std::clamp(r.dot(axis) / axis.squaredNorm(), 0.0, 1.0) : 0.0;
      const double gap = (r - s * axis).norm() - tube.radius;
      // A camera that sits in the body's padding sees out of it.
      if (gap < 1e-4) return t > 0 ? t : std::numeric_limits<double>::infinity();
      t += gap / speed;
    }
    return std::numeric_limits<double>::infinity();
  }
};

// The robot's collision bodies at a configuration.
inline std::vector<Tube> robot_tubes(const RobotModel& model, const RobotModel::Data& data) {
  std::vector<Tube> tubes;
  for (const Capsule& c : model.capsules()) {
    tubes.push_back({data.X_WL[c.body] * c.p0, data.X_WL[c.body] * c.p1, c.radius});
  }
  for (const Sphere& s : model.spheres()) {
    tubes.push_back({data.X_WL[s.body] * s.centre, data.X_WL[s.body] * s.centre, s.radius});
  }
  return tubes;
}

// Noise as DEFINITIONS.md has it: 1.5 mm times z squared, 1 % drop-outs; none without a generator.
inline void render(const Scene& scene, const Eigen::Isometry3d& X_WC, DepthFrame& frame,
                   std::mt19937* noise = nullptr) {
  const CameraIntrinsics& k = frame.intrinsics;
  frame.depth.resize(static_cast<std::size_t>(k.width) * k.height);
  std::normal_distribution<double> gauss(0.0, 1.0);
  std::bernoulli_distribution lost(0.01);
  for (int v = 0; v < k.height; ++v) {
    for (int u = 0; u < k.width; ++u) {
      const Eigen::Vector3d d_C((u + 0.5 - k.cx) / k.fx, (v + 0.5 - k.cy) / k.fy, 1.0);
      double z = scene.cast(X_WC.translation(), X_WC.linear() * d_C);
      if (noise) {
        z += 0.0015 * z * z * gauss(*noise);
        if (lost(*noise)) z = std::numeric_limits<double>::infinity();
      }
      frame.depth[v * k.width + u] = z >= k.range_min_m && z <= k.range_max_m
                                         ? static_cast<float>(z)
                                         : std::numeric_limits<float>::infinity();
    }
  }
}

}  // namespace wb::test
