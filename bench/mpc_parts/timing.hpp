// What a call of the solver costs on the reference problem, in equivalent time, and whether its
// work and its commanded rates stay within their bounds. One thread.
#pragma once
#include <algorithm>

#include "bench/equivalent_time.hpp"
#include "bench/mpc_parts/reference_problem.hpp"
#include "core/rt/allocation_count.hpp"

namespace wb::bench {

struct TimingResult {
  double median_ms = 0, p99_ms = 0, tail_ratio = 0, sweep_ms = 0;
  double rate_over_limit_percent = 0;
  double work_over_bound = 0;  // largest count over its bound; 1 at the bound
  double no_step_percent = 0, median_step = 0;
  std::uint64_t allocations = 0;
};

inline TimingResult time_reference_problem(const GridSettings& grid, int calls) {
  const auto problem = reference_problem(grid);
  const DistanceField field = reference_field();
  SlqSolver solver(problem);
  const WorkBound bound = solver.work_bound();
  Policy policy;
  SolveReport report;
  EquivalentTimer timer(1);
  TimingResult out;
  std::vector<double> steps;
  StateVector x = reference_start(), next(x.size());
  std::array<double, kMaxInputs> u;
  int no_step = 0;
  for (int call = 0; call < calls; ++call) {
    const TimeNs t = call * kCallPeriod;
    const Reference goal = reference_goal(t);
    timer.time([&] {
      const std::uint64_t allocations = thread_allocations();
      (void)solver.solve({.t0 = t, .x0 = x.data(), .reference = &goal, .field = &field}, policy,
                         report);
      out.allocations = std::max(out.allocations, thread_allocations() - allocations);
    });
    no_step += report.step == 0;
    steps.push_back(report.step);
    const auto share = [](int count, int most) { return static_cast<double>(count) / most; };
    out.work_over_bound =
        std::max({out.work_over_bound, share(report.node_evaluations, bound.node_evaluations),
                  share(report.term_evaluations, bound.term_evaluations),
                  share(report.factorisations, bound.factorisations),
                  share(report.nodes, problem->nodes())});
    // The robot follows the policy's own prediction; what is commanded on the way counts.
    for (TimeNs at = t; at <= t + kCallPeriod; at += kCallPeriod / 4) {
      StateVector x_ref(x.size());
      (void)policy.evaluate(at, x.data(), u.data(), x_ref.data());
      (void)policy.evaluate(at, x_ref.data(), u.data(), next.data());
      for (int r = 0; r < problem->nu(); ++r) {
        out.rate_over_limit_percent =
            std::max(out.rate_over_limit_percent,
                     100 * (std::abs(u[r]) / problem->limits().velocity[r] - 1));
      }
    }
    x = next;
  }
  out.median_ms = timer.quantile_ms(0.5);
  out.p99_ms = timer.quantile_ms(0.99);
  out.sweep_ms = timer.sweep_median_ms();
  out.tail_ratio =
      (out.p99_ms / out.median_ms) / (timer.sweep_quantile_ms(0.99) / timer.sweep_quantile_ms(0.5));
  out.no_step_percent = 100.0 * no_step / calls;
  out.median_step = quantile(steps, 0.5);
  return out;
}

// One evaluation of a policy, in equivalent microseconds.
inline double policy_evaluation_us() {
  const auto problem = reference_problem(kGrid4s);
  SlqSolver solver(problem);
  Policy policy;
  SolveReport report;
  const StateVector x = reference_start();
  const Reference goal = reference_goal(0);
  (void)solver.solve({.t0 = 0, .x0 = x.data(), .reference = &goal}, policy, report);
  constexpr int kEvaluations = 1000;
  EquivalentTimer timer(1);
  std::array<double, kMaxInputs> u;
  StateVector x_ref(x.size());
  double sum = 0;
  for (int i = 0; i < 200; ++i) {
    timer.time([&] {
      for (int k = 0; k < kEvaluations; ++k) {
        (void)policy.evaluate((k % 390) * kCallPeriod, x.data(), u.data(), x_ref.data());
        sum += u[0];
      }
    });
  }
  return sum == 1.0 ? 0 : 1e3 * timer.quantile_ms(0.5) / kEvaluations;
}

}  // namespace wb::bench
