// How good the motion is that comes of one iteration a call: the cost that the robot really incurs,
// and where it ends up.
#pragma once
#include "bench/mpc_parts/reference_problem.hpp"

namespace wb::bench {

// Cost of a run, accumulated on a 5 ms rollout of the policy in force; a call every 10 ms, with
// `iterations` of them at most.
inline double closed_loop_cost(const GridSettings& grid, int calls, int iterations,
                               double tolerance) {
  constexpr int kParts = 2;  // of a call's period: 5 ms
  const double dt = to_seconds(kCallPeriod) / kParts;
  const auto problem = reference_problem(grid);
  const DistanceField field = reference_field();
  SlqSolver solver(problem);
  auto policy = std::make_unique<Policy>();
  SolveReport report;
  const Weights weights = problem->weights().configured();
  StateVector x = reference_start(), next(x.size()), x_ref(x.size());
  InputVector u(problem->nu());
  Node node;
  double cost = 0;
  for (int call = 0; call < calls; ++call) {
    const TimeNs t = call * kCallPeriod;
    const Reference goal = reference_goal(t);
    solver.converge({.t0 = t, .x0 = x.data(), .reference = &goal, .field = &field}, iterations,
                    tolerance, *policy, report);
    for (int part = 0; part < kParts; ++part) {
      const TimeNs at = t + part * (kCallPeriod / kParts);
      (void)policy->evaluate(at, x.data(), u.data(), x_ref.data());
      u = u.cwiseMax(-problem->limits().velocity).cwiseMin(problem->limits().velocity);
      const ReferenceSample want = sample(goal, at);
      node.reference = &goal;
      node.field = &field;
      node.sample = &want;
      node.weights = weights.values.data();
      node.x = x;
      node.u = u;
      cost += dt * problem->evaluate(node, nullptr, nullptr);
      problem->step(x.data(), u.data(), dt, next.data());
      x = next;
    }
  }
  return cost;
}

// Position error of the end-effector after 10 s at 10 Hz towards the reference's static goal, in
// millimetres; self-collision on, no field, as in the reference's own test.
inline double static_goal_error_mm() {
  constexpr TimeNs kPeriod = kNanosPerSecond / 10;
  const auto problem = reference_problem(kGrid4s);
  SlqSolver solver(problem);
  auto policy = std::make_unique<Policy>();
  SolveReport report;
  StateVector x = reference_start(), next(x.size()), x_ref(x.size());
  InputVector u(problem->nu());
  const Reference goal = reference_goal(0);
  for (int call = 0; call < 100; ++call) {
    const TimeNs t = call * kPeriod;
    (void)solver.solve({.t0 = t, .x0 = x.data(), .reference = &goal}, *policy, report);
    for (TimeNs at = t; at < t + kPeriod; at += kPeriod / 40) {
      (void)policy->evaluate(at, x.data(), u.data(), x_ref.data());
      problem->step(x.data(), u.data(), to_seconds(kPeriod / 40), next.data());
      x = next;
    }
  }
  RobotModel::Data data;
  problem->model().forward_kinematics(x.data(), data);
  const Eigen::Isometry3d X_WE = problem->model().X_WF(problem->model().end_effector(), data);
  return 1e3 * (X_WE.translation() - goal.ee[0].keyframes[0].X_WE.position()).norm();
}

}  // namespace wb::bench
