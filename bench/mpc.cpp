// The MPC's bench: cost of a solve on the reference problem, quality of the motion, and what the
// solver promises (docs/how-to/study.md). One thread; times in equivalent time. Exit code 1: a
// bound is broken.
#include <CLI/CLI.hpp>

#include "bench/figures.hpp"
#include "bench/mpc_parts/closed_loop.hpp"
#include "bench/mpc_parts/derivative_check.hpp"
#include "bench/mpc_parts/optimality_check.hpp"
#include "bench/mpc_parts/ranking.hpp"
#include "bench/mpc_parts/scaling.hpp"
#include "bench/mpc_parts/timing.hpp"

namespace {

using wb::bench::Figure;

void add_timing(std::vector<Figure>& figures) {
  using namespace wb::bench;
  double over = -100, work = 0, tail = 0;
  double allocations = 0;
  for (const auto& [name, grid, bound] :
       {std::tuple{"4s", kGrid4s, 2.0}, std::tuple{"1s", kGrid1s, 0.6}}) {
    double median = 0;
    for (const auto& [run, calls] : {std::pair{"short", 400}, std::pair{"long", 1500}}) {
      const TimingResult r = time_reference_problem(grid, calls);
      const std::string prefix = std::string("mpc_") + name + "_" + run;
      figures.push_back({prefix + "_median_ms", r.median_ms, "ms", bound});
      figures.push_back({prefix + "_p99_ms", r.p99_ms, "ms", {}});
      figures.push_back({prefix + "_tail_ratio", r.tail_ratio, "", {}});
      figures.push_back({prefix + "_no_step", r.no_step_percent, "%", {}});
      figures.push_back({prefix + "_step_median", r.median_step, "", {}});
      median = std::max(median, r.median_ms);
      if (grid.horizon_s > 1) tail = std::max(tail, r.tail_ratio);
      over = std::max(over, r.rate_over_limit_percent);
      work = std::max(work, r.work_over_bound);
      allocations = std::max(allocations, static_cast<double>(r.allocations));
    }
    figures.push_back({std::string("mpc_") + name + "_median_ms", median, "ms", bound});
  }
  figures.push_back({"mpc_4s_tail_ratio", tail, "", 1.3});
  figures.push_back({"work_over_bound", work, "", 1.0});
  figures.push_back({"rate_over_limit_percent", over, "%", 1.0});
  figures.push_back({"allocations_per_solve", allocations, "", 0.0});
  figures.push_back({"policy_evaluation_us", policy_evaluation_us(), "us", 1.0});
}

void add_scaling(std::vector<Figure>& figures) {
  using namespace wb::bench;
  const std::vector<ScalingPoint> points = scaling();
  for (const ScalingPoint& p : points)
    figures.push_back(
        {"solve_ms_" + p.over + "_" + std::to_string(p.count), p.median_ms, "ms", {}});
  for (const char* over : {"nodes", "spheres"})
    figures.push_back(
        {std::string("linearity_") + over, linearity(points, over), "", 0.9, Better::kHigher});
}

// Over all robots of config/robots.
void add_checks(std::vector<Figure>& figures, unsigned seed) {
  using namespace wb::bench;
  double derivatives = 0, kkt = 0;
  for (const std::string& robot : robot_names()) {
    const auto model = load_robot(robot);
    const auto problem = std::make_shared<const wb::OptimalControlProblem>(model);
    Situations situations(problem, seed);
    int kinks = 0, entries = 0;
    for (const auto& term : problem->terms()) {
      const DerivativeCheck check = check_derivatives(*problem, *term, situations, 100);
      derivatives = std::max(derivatives, check.worst);
      kinks += check.kinks;
      entries += check.entries;
    }
    figures.push_back({"kinks_" + robot, 100.0 * kinks / entries, "%", {}});
    // The field is interpolated on a grid: its slope jumps, and no optimum there has one.
    const OptimalityCheck check =
        check_optimality(std::make_shared<const wb::OptimalControlProblem>(
                             model, std::vector<std::string>{"environment"}),
                         100, seed);
    figures.push_back({"kkt_residual_" + robot, check.worst, "1/s", {}});
    figures.push_back({"kkt_iterations_" + robot, static_cast<double>(check.iterations), "", {}});
    kkt = std::max(kkt, check.worst);
  }
  figures.push_back({"derivative_error_max", derivatives, "", 1e-6});
  figures.push_back({"kkt_residual_max", kkt, "1/s", 1e-8});
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("MPC bench");
  std::string json;
  bool timing_only = false;
  int calls = 1500, scenes = 32;
  unsigned seed = 1000;
  app.add_option("--json", json, "write the figures to this file");
  app.add_flag("--timing-only", timing_only, "cost of a solve only");
  app.add_option("--closed-loop-calls", calls, "length of the run whose cost is compared");
  app.add_option("--scenes", scenes, "of the ranking");
  app.add_option("--seed", seed, "of the random problems and scenes");
  CLI11_PARSE(app, argc, argv);
  using namespace wb::bench;
  std::vector<Figure> figures;
  add_timing(figures);
  if (!timing_only) {
    add_scaling(figures);
    add_checks(figures, seed);
    const RankingResult ranking = rank_options(scenes, seed);
    figures.push_back({"options_32_s", ranking.options_32_s, "s", 1.5});
    figures.push_back({"options_agreeing_of_32", 32.0 * ranking.agreeing / ranking.scenes, "", 30.0,
                       Better::kHigher});
    figures.push_back(
        {"options_winners", static_cast<double>(ranking.winners), "", 2.0, Better::kHigher});
    figures.push_back({"options_worst_regret", 100 * ranking.worst_regret, "%", {}});
    figures.push_back({"static_goal_error_mm", static_goal_error_mm(), "mm", 2.0});
    const double ours = closed_loop_cost(kGrid4s, calls, 1, 0.0);
    const double converged = closed_loop_cost(kGrid10ms, calls, 30, 1e-4);
    figures.push_back({"closed_loop_cost_ratio", ours / converged, "", 1.05});
  }
  print_table(figures);
  if (!json.empty()) write_json(figures, json);
  return all_hold(figures) ? 0 : 1;
}
