// Residual of the optimality conditions (KKT) of a solved problem, from the problem's own gradients
// and not from the solver's sweep: multipliers by an adjoint recursion, slopes of the inputs with
// the box's complementarity. Unit: cost per second and unit of u.
#pragma once
#include "bench/mpc_parts/situation.hpp"

namespace wb::bench {

// Largest slope along which an input could still move within its box; for a solve from rest, where
// the acceleration limits open the box from zero.
inline double kkt_residual(const OptimalControlProblem& problem, const SlqSolver& solver,
                           const Reference& reference, const Weights& weights, TimeNs t0) {
  const auto x = solver.states();
  const auto u = solver.inputs();
  const int last = static_cast<int>(x.size()) - 1;
  const auto gradient = [&](int i, Quadratic& quadratic) {
    Node node;
    const ReferenceSample want = sample(reference, t0 + from_seconds(problem.grid()[i]));
    node.reference = &reference;
    node.sample = &want;
    node.weights = weights.values.data();
    node.terminal = i == last;
    node.x = x[i];
    if (!node.terminal) node.u = u[i];
    (void)problem.evaluate(node, &quadratic, nullptr);
  };
  Quadratic quadratic;
  gradient(last, quadratic);
  StateVector lambda = problem.weight_s(last) * quadratic.q;
  double worst = 0;
  for (int i = last - 1; i >= 0; --i) {
    gradient(i, quadratic);
    StateMatrix A;
    StateInputMatrix B;
    const double dt = problem.weight_s(i);
    problem.step_derivatives(x[i].data(), u[i].data(), dt, A, B);
    const InputVector slope = quadratic.r + B.transpose() * lambda / dt;
    for (int r = 0; r < slope.size(); ++r) {
      const double limit =
          std::min(reference.speed_scale * problem.limits().velocity[r],
                   problem.solver().acceleration_fraction * problem.limits().acceleration[r] *
                       (problem.grid()[i] + problem.grid()[1]));
      const bool held = (u[i][r] >= limit && slope[r] < 0) || (u[i][r] <= -limit && slope[r] > 0);
      if (!held) worst = std::max(worst, std::abs(slope[r]));
    }
    lambda = dt * quadratic.q + A.transpose() * lambda;
  }
  return worst;
}

struct OptimalityCheck {
  double worst = 0;
  int problems = 0, iterations = 0;  // the most that a problem took
};

// Random problems: a state within the limits, a goal within the arm's reach.
inline OptimalityCheck check_optimality(std::shared_ptr<const OptimalControlProblem> problem,
                                        int problems, unsigned seed) {
  constexpr int kMostIterations = 3000;
  constexpr double kTolerance = 1e-12;
  OptimalityCheck out;
  Situations situations(problem, seed);
  SlqSolver solver(problem);
  auto policy = std::make_unique<Policy>();
  SolveReport report;
  for (; out.problems < problems; ++out.problems) {
    const StateVector x0 = situations.free_state();
    const Reference goal = situations.reachable_goal(x0, 0.4);
    solver.reset();
    const int iterations = solver.converge({.t0 = 0, .x0 = x0.data(), .reference = &goal},
                                           kMostIterations, kTolerance, *policy, report);
    out.iterations = std::max(out.iterations, iterations);
    const double residual = kkt_residual(*problem, solver, goal, situations.weights(), 0);
    out.worst = std::max(out.worst, std::isfinite(residual) ? residual : 1e9);
  }
  return out;
}

}  // namespace wb::bench
