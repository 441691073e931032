// What every scene interpreter does: from what it has seen, say how an object moves and where its
// handle is. Perception job. Frames: W odometry. The oracle (truth with error) is the only
// interpreter so far; point clouds come behind the same type.
#pragma once
#include "core/types/object_plan.hpp"
#include "core/types/robot_state.hpp"

namespace wb {

class SceneInterpreter {
 public:
  virtual ~SceneInterpreter() = default;
  // Fills articulation, X_WG, handle, masks and `measured` of `plan` (not its keyframes). False:
  // the object is not known.
  virtual bool interpret(const Name& object, const RobotState& state, ObjectPlan& plan) = 0;
};

}  // namespace wb
