// The cost of a solve over nodes, spheres and joints, each varied alone about the reference
// problem. Equivalent time.
#pragma once
#include <fstream>
#include <regex>
#include <sstream>

#include "bench/equivalent_time.hpp"
#include "bench/mpc_parts/reference_problem.hpp"

namespace wb::bench {

struct ScalingPoint {
  std::string over;  // "nodes", "spheres", "joints"
  int count = 0;
  double median_ms = 0;
};

inline double solve_median_ms(std::shared_ptr<const OptimalControlProblem> problem) {
  const DistanceField field = reference_field();
  SlqSolver solver(problem);
  auto policy = std::make_unique<Policy>();
  SolveReport report;
  EquivalentTimer timer(1);
  StateVector x = reference_start().head(problem->nx());
  for (int call = 0; call < 120; ++call) {
    const TimeNs t = call * kCallPeriod;
    const Reference goal = reference_goal(t);
    timer.time([&] {
      (void)solver.solve({.t0 = t, .x0 = x.data(), .reference = &goal, .field = &field}, *policy,
                         report);
    });
    x = solver.states()[1];
  }
  return timer.quantile_ms(0.5);
}

inline std::vector<ScalingPoint> scaling() {
  std::ifstream in(WB_SOURCE_DIR "/bench/reference_problem/mpc.yaml");
  std::ostringstream text;
  text << in.rdbuf();
  // The problem with other numbers of spheres and joints; joints that are left out are locked.
  const auto problem = [&](const GridSettings& grid, int spheres, int joints) {
    RobotConfig config = reference_robot()->config();
    const std::vector<SphereConfig> given = config.spheres;
    config.spheres.clear();
    for (int i = 0; i < spheres; ++i)
      config.spheres.push_back(given[static_cast<std::size_t>(i) % given.size()]);
    config.joints.resize(static_cast<std::size_t>(joints));
    const auto list = [&](const char* value) {
      std::string out = "[";
      for (int j = 0; j < joints; ++j) out += std::string(j ? ", " : "") + value;
      return out + "]";
    };
    std::string yaml = std::regex_replace(text.str(), std::regex("velocity_s2prad2: \\[[^\\]]*\\]"),
                                          "velocity_s2prad2: " + list("0.01"));
    yaml = std::regex_replace(yaml, std::regex("position_prad2: \\[[^\\]]*\\]"),
                              "position_prad2: " + list("0"));
    return std::make_shared<const OptimalControlProblem>(std::make_shared<const RobotModel>(config),
                                                         config::Section::parse(yaml, "mpc.yaml"),
                                                         std::vector<std::string>{}, &grid);
  };
  std::vector<ScalingPoint> out;
  for (const int nodes : {20, 40, 80, 160, 320})
    out.push_back({"nodes", nodes + 1,
                   solve_median_ms(problem({0.02, 0.02 * nodes, 0.1, 0.02 * nodes}, 20, 6))});
  for (const int spheres : {0, 10, 20, 30, 40, 50, 60})
    out.push_back({"spheres", spheres, solve_median_ms(problem(kGrid4s, spheres, 6))});
  for (const int joints : {2, 3, 4, 5, 6})
    out.push_back({"joints", joints, solve_median_ms(problem(kGrid4s, 20, joints))});
  return out;
}

// Share of the variance over a count that a straight line explains.
inline double linearity(const std::vector<ScalingPoint>& points, const std::string& over) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0;
  for (const ScalingPoint& p : points) {
    if (p.over != over) continue;
    n += 1;
    sx += p.count;
    sy += p.median_ms;
    sxx += static_cast<double>(p.count) * p.count;
    sxy += p.count * p.median_ms;
    syy += p.median_ms * p.median_ms;
  }
  const double covariance = n * sxy - sx * sy;
  return covariance * covariance / ((n * sxx - sx * sx) * (n * syy - sy * sy));
}

}  // namespace wb::bench
