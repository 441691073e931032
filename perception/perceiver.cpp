#include "perception/perceiver.hpp"

#include "perception/keyframe_generator.hpp"

namespace wb {

Perceiver::Perceiver(std::shared_ptr<const RobotModel> model,
                     std::unique_ptr<SceneInterpreter> interpreter)
    : interpreter_(std::move(interpreter)) {
  StateVector x = StateVector::Zero(model->nx());
  for (int i = 0; i < model->joints(); ++i) x[model->base_dof() + i] = model->config().ready[i];
  RobotModel::Data data;
  model->forward_kinematics(x.data(), data);
  X_BE_ready_ = model->X_WF(model->end_effector(), data);
}

bool Perceiver::step(const RobotState& state, ObjectPlan& plan) {
  if (!interpreter_ || object_.view().empty()) return false;
  plan.object = object_;
  plan.t_ns = state.t_ns;
  if (!interpreter_->interpret(object_, state, plan)) return false;
  // The base will face the front; then the ready posture says which way the hand's x axis points.
  const Eigen::Vector3d approach_W = plan.X_WG.isometry().linear().col(2),
                        approach_B = X_BE_ready_.linear().col(2);
  const double yaw =
      std::atan2(approach_W.y(), approach_W.x()) - std::atan2(approach_B.y(), approach_B.x());
  KeyframeGenerator(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * X_BE_ready_.linear().col(0))
      .generate(plan);
  return true;
}

}  // namespace wb
