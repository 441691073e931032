#include "planning/motion_planner.hpp"

namespace wb {

MotionPlanner::MotionPlanner(std::shared_ptr<const RobotModel> model, const std::vector<std::string>& disabled_terms)
    : model_(std::move(model)),
      problem_(std::make_shared<OptimalControlProblem>(model_, disabled_terms)),
      solver_(problem_),
      route_(model_->config().base, config::Section::open(model_->config().folder / "route.yaml")) {}

SolveStatus MotionPlanner::step(const RobotState& state, const Reference& reference, const DistanceField* field, Policy& policy,
                                SolveReport& report) RT_SAFE {
  reference_ = reference;
  if (reference_.base_goal_active) route_.plan(state.t_ns, state.base, state.base_velocity, field, reference_);
  // The arm's part of x0 is where the servos' set-points stand: the policy moves set-points, and the servo follows them.
  std::array<double, kMaxStates> x0{};
  const int base = model_->base_dof();
  for (int i = 0; i < base; ++i) x0[i] = state.base[i];
  for (int i = 0; i < model_->joints(); ++i) x0[base + i] = state.q_command[i];
  const SolveStatus status = solver_.solve({state.t_ns, x0.data(), &reference_, field}, policy, report);
  policy.reference_seq = reference.seq;
  policy.field_seq = field ? field->seq : 0;
  return status;
}

}  // namespace wb
