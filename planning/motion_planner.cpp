#include "planning/motion_planner.hpp"

#include <cmath>

namespace wb {

MotionPlanner::MotionPlanner(std::shared_ptr<const RobotModel> model,
                             const std::vector<std::string>& disabled_terms)
    : model_(std::move(model)),
      problem_(std::make_shared<OptimalControlProblem>(model_, disabled_terms)),
      solver_(problem_) {
  const RobotConfig& robot = model_->config();
  if (model_->base_dof() > 0) {
    route_ =
        std::make_unique<BaseRoute>(robot.base, config::Section::open(robot.folder / "route.yaml"));
  }
}

void MotionPlanner::guess_from_route(const std::array<double, kMaxStates>& x0) RT_SAFE {
  const int joints = model_->joints();
  guess_.nodes = reference_.base_count;
  guess_.states = model_->nx();
  guess_.inputs = model_->nu();
  for (int i = 0; i < guess_.nodes; ++i) {
    const BaseKeyframe& k = reference_.base[i];
    guess_.t[i] = k.t_ns;
    for (int r = 0; r < 3; ++r) guess_.x(i)[r] = k.base[r];
    for (int r = 0; r < joints; ++r) guess_.x(i)[3 + r] = x0[3 + r];
    guess_.u(i).setZero();
    guess_.K(i).setZero();
    if (i + 1 == guess_.nodes) break;
    const BaseKeyframe& next = reference_.base[i + 1];
    const double dt = to_seconds(next.t_ns - k.t_ns), heading = 0.5 * (k.base[2] + next.base[2]);
    const double dx = (next.base[0] - k.base[0]) / dt, dy = (next.base[1] - k.base[1]) / dt;
    const int turn = model_->base_inputs() - 1;
    guess_.u(i)[0] = dx * std::cos(heading) + dy * std::sin(heading);
    if (turn == 2) guess_.u(i)[1] = dy * std::cos(heading) - dx * std::sin(heading);
    guess_.u(i)[turn] = (next.base[2] - k.base[2]) / dt;
  }
}

SolveStatus MotionPlanner::step(const RobotState& state, const Reference& reference,
                                const DistanceField* field, Policy& policy, SolveReport& report,
                                const Weights* weights) RT_SAFE {
  reference_ = reference;
  if (route_ && reference_.base_goal_active)
    route_->plan(state.t_ns, state.base, state.base_velocity, field, reference_);
  // The arm's part of x0 is where the servos' set-points stand: the policy moves set-points, and
  // the servo follows them.
  std::array<double, kMaxStates> x0{};
  const int base = model_->base_dof();
  for (int i = 0; i < base; ++i) x0[i] = state.base[i];
  for (int i = 0; i < model_->joints(); ++i) x0[base + i] = state.q_command[i];
  // Following the route is a warm start, too: the solver takes it when its own has strayed into a
  // worse valley.
  const bool routed = route_ && reference_.base_goal_active && reference_.base_count > 1;
  if (routed) guess_from_route(x0);
  const SolveStatus status = solver_.solve(
      {state.t_ns, x0.data(), &reference_, field, routed ? &guess_ : nullptr, weights}, policy,
      report);
  policy.reference_seq = reference.seq;
  policy.field_seq = field ? field->seq : 0;
  return status;
}

}  // namespace wb
