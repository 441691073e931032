// The reference problem of the MPC bench: robot, goals, field and start state (facts: OCS2's
// mobile_manipulator for Mabi-Mobile; DEFINITIONS.md, "Reference field"). Setup world. SI, frame W.
#pragma once
#include <memory>
#include <string>

#include "mpc/slq_solver.hpp"

namespace wb::bench {

inline constexpr TimeNs kCallPeriod = kNanosPerSecond / 100;
inline constexpr TimeNs kGoalPeriod = 3 * kNanosPerSecond;

inline std::shared_ptr<const RobotModel> reference_robot() {
  static const auto model = std::make_shared<const RobotModel>(
      RobotConfig::load(WB_SOURCE_DIR "/bench/reference_problem"));
  return model;
}

inline constexpr GridSettings kGrid4s{0.04, 1.0, 0.1, 4.0}, kGrid1s{0.04, 1.0, 0.1, 1.0},
    kGrid10ms{0.01, 4.0, 0.1, 4.0};

inline std::shared_ptr<const OptimalControlProblem> reference_problem(const GridSettings& grid) {
  return std::make_shared<const OptimalControlProblem>(
      reference_robot(), config::Section::open(WB_SOURCE_DIR "/bench/reference_problem/mpc.yaml"),
      std::vector<std::string>{}, &grid);
}

inline StateVector reference_start() {
  StateVector x(9);
  x << 0, 0, 0, 2.5, -1.0, 1.5, 0, 1.0, 0;
  return x;
}

// The goal in force at t: they switch every 3 s.
inline Reference reference_goal(TimeNs t) {
  static constexpr double kGoals[4][7] = {{-0.5, -0.8, 0.6, 0.33, 0, 0, 0.95},
                                          {0.4, -0.6, 0.9, 0, 0.33, 0, 0.95},
                                          {0.6, 0.5, 0.5, 0, 0, 0.33, 0.95},
                                          {-0.3, 0.5, 0.8, -0.33, 0, 0, 0.95}};
  const double* g = kGoals[(t / kGoalPeriod) % 4];
  Reference reference;
  reference.ee[0].count = 1;
  reference.ee[0].keyframes[0].X_WE =
      Pose::from({g[0], g[1], g[2]}, Eigen::Quaterniond(g[6], g[3], g[4], g[5]).normalized());
  return reference;
}

// Walls at x = +-3 m and y = +-2.5 m, a box 0.8 x 0.8 x 0.7 m at (1.2, -1.2); exact distances at
// the voxels' centres.
inline DistanceField reference_field() {
  DistanceField field({120, 120, 40}, 0.1);
  field.seq = 1;
  field.origin_W = {-6.0, -6.0, -0.5};
  for (int k = 0; k < 40; ++k) {
    for (int j = 0; j < 120; ++j) {
      for (int i = 0; i < 120; ++i) {
        const Eigen::Vector3d p = field.origin_W + 0.1 * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5);
        const double walls = std::min(3.0 - std::abs(p.x()), 2.5 - std::abs(p.y()));
        const Eigen::Vector3d d =
            (p - Eigen::Vector3d(1.2, -1.2, 0.35)).cwiseAbs() - Eigen::Vector3d(0.4, 0.4, 0.35);
        const double box = d.maxCoeff() > 0 ? d.cwiseMax(0.0).norm() : d.maxCoeff();
        field.at(i, j, k) = static_cast<float>(std::min(walls, box));
      }
    }
  }
  return field;
}

}  // namespace wb::bench
