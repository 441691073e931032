// True distances between the robot's solids and the scene's, by FCL on the plant's own primitives.
// Asked for by benches and tests only, never from a step: about 0.13 ms. Frame S; metres.
#pragma once
#include <fcl/fcl.h>
#include <mujoco/mujoco.h>

#include <memory>
#include <vector>

#include "drivers/sim/contacts.hpp"

namespace wb::sim {

class Clearance {
 public:
  Clearance(const mjModel& model, const ContactLog& kinds);

  // The smallest distance from the robot to a geom of the scene that is not skipped; 0 where they
  // touch. The floor does not count.
  double robot_to_scene(const mjData& data, const std::vector<bool>& skipped);
  // Whether a vertical column on the floor touches nothing of the scene.
  bool column_is_free(const mjData& data, double x_m, double y_m, double radius_m);

 private:
  struct Body {
    int geom = 0;
    double bounding_radius = 0;
    std::unique_ptr<fcl::CollisionObjectd> object;
  };
  struct Pair {
    double lower_bound = 0;
    std::size_t robot = 0, scene = 0;
  };
  static void update(std::vector<Body>& bodies, const mjData& data);

  std::vector<Body> robot_, scene_;
  std::vector<Pair> pairs_;
};

}  // namespace wb::sim
