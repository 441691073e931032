// Which pixels of a depth frame show the robot itself: those whose point lies within one of its
// collision spheres or capsules, padded, at the frame's stamp. Mapping loop, step world. Only
// pixels within a body's bounding rectangle are tested. Frames: C camera (optical), L the model's
// bodies.
#pragma once
#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "core/model/robot_model.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/depth_frame.hpp"

namespace wb {

class RobotFilter {
 public:
  RobotFilter(const RobotModel& model, double padding_m);

  // Writes 1 for pixels on the robot and 0 for all others (width * height bytes); returns how many
  // are on it.
  int mark(const DepthFrame& frame, const Eigen::Isometry3d& X_WC, const RobotModel::Data& data,
           std::uint8_t* on_robot) const RT_SAFE;

 private:
  struct Body {  // a capsule; a sphere where p0 = p1
    int body = 0;
    Eigen::Vector3d p0, p1;  // in L [m]
    double radius = 0;       // padded [m]
  };
  std::vector<Body> bodies_;
};

}  // namespace wb
