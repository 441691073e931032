// The perception job, 10 Hz: keeps an ObjectPlan of the object that was asked for. Ordinary thread.
#pragma once
#include <memory>

#include "core/model/robot_model.hpp"
#include "perception/scene_interpreter.hpp"

namespace wb {

class Perceiver {
 public:
  // Without an interpreter no object is ever found.
  Perceiver(std::shared_ptr<const RobotModel> model, std::unique_ptr<SceneInterpreter> interpreter);

  void look_for(const Name& object) { object_ = object; }
  // Fills `plan`; false: nothing asked for, or not found. state: newest.
  bool step(const RobotState& state, ObjectPlan& plan);

 private:
  std::unique_ptr<SceneInterpreter> interpreter_;
  Eigen::Isometry3d X_BE_ready_;
  Name object_;
};

}  // namespace wb
