// Options and scenes of the ranking bench: grasp points along a 0.5 m handle of a drawer in front
// of the robot, one box of 0.3 x 0.3 x 0.6 m beside or in front of it (DEFINITIONS.md, "Options").
// Frame W, SI. Seeded.
#pragma once
#include <algorithm>
#include <random>
#include <set>

#include "bench/equivalent_time.hpp"
#include "planning/option_ranker.hpp"

namespace wb::bench {

inline constexpr int kOptions = 32;

struct RankingScene {
  DistanceField field{{80, 80, 30}, 0.1};
  std::vector<Reference> options;
  StateVector x0;
};

inline RankingScene make_ranking_scene(const RobotModel& model, unsigned seed) {
  constexpr double kFront = 1.7, kHeight = 0.75, kHandle = 0.5, kPull = 0.4;
  std::mt19937 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  RankingScene scene;
  scene.x0 = StateVector(model.nx());
  scene.x0 << uniform(-0.1, 0.1), uniform(-0.2, 0.2), uniform(-0.2, 0.2),
      Eigen::Map<const Eigen::VectorXd>(model.config().ready.data(), model.joints());
  // The unit, and the box: beside the way of the base or in front of the drawer.
  const bool beside = uniform(0, 1) < 0.5;
  const double side = uniform(0, 1) < 0.5 ? -1 : 1;
  const Eigen::Vector3d box(beside ? uniform(0.9, 1.3) : uniform(1.35, 1.5),
                            side * (beside ? uniform(0.75, 1.1) : uniform(0.3, 0.6)), 0.3);
  const Eigen::Vector3d centres[2] = {{kFront + 0.3, 0, 0.45}, box};
  const Eigen::Vector3d halves[2] = {{0.3, 0.8, 0.45}, {0.15, 0.15, 0.3}};
  scene.field.seq = 1;
  scene.field.origin_W = {-4, -4, -0.5};
  for (int k = 0; k < 30; ++k) {
    for (int j = 0; j < 80; ++j) {
      for (int i = 0; i < 80; ++i) {
        const Eigen::Vector3d p =
            scene.field.origin_W + 0.1 * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5);
        double nearest = DistanceField::kNoMap;
        for (int b = 0; b < 2; ++b) {
          const Eigen::Vector3d d = (p - centres[b]).cwiseAbs() - halves[b];
          nearest = std::min(nearest, d.maxCoeff() > 0 ? d.cwiseMax(0.0).norm() : d.maxCoeff());
        }
        scene.field.at(i, j, k) = static_cast<float>(nearest);
      }
    }
  }
  // E's z into the front, its x along the bar: as the ready posture has it.
  Eigen::Matrix3d R;
  R.col(2) = Eigen::Vector3d::UnitX();
  R.col(0) = Eigen::Vector3d::UnitY();
  R.col(1) = R.col(2).cross(R.col(0));
  RobotModel::Data data;
  model.forward_kinematics(scene.x0.data(), data);
  if (model.X_WF(model.end_effector(), data).linear().col(0).dot(R.col(0)) < 0) {
    R.col(0) *= -1;
    R.col(1) *= -1;
  }
  for (int i = 0; i < kOptions; ++i) {
    const double along = kHandle * ((i + 0.5) / kOptions - 0.5);
    const Eigen::Vector3d grasp(kFront - 0.05, along, kHeight);
    Reference option;
    EndEffectorReference& ee = option.ee[0];
    const Eigen::Quaterniond q(R);
    ee.count = 4;
    ee.keyframes[0] = {from_seconds(3.0), Pose::from(grasp - Eigen::Vector3d(0.1, 0, 0), q)};
    ee.keyframes[1] = {from_seconds(4.0), Pose::from(grasp, q)};
    ee.keyframes[2] = {from_seconds(5.0), Pose::from(grasp, q)};
    ee.keyframes[3] = {from_seconds(9.0), Pose::from(grasp - Eigen::Vector3d(kPull, 0, 0), q)};
    option.masks[0].active = true;
    option.masks[0].X_WM.p = {centres[0].x(), centres[0].y(), centres[0].z()};
    option.masks[0].half_extent = {halves[0].x() + 0.1, halves[0].y(), halves[0].z()};
    scene.options.push_back(option);
  }
  return scene;
}

struct RankingResult {
  double options_32_s = 0;       // median over the scenes, equivalent time
  int scenes = 0, agreeing = 0;  // the same option is the best one
  int winners = 0;               // different options that were best in some scene
  double worst_regret = 0;       // converged cost of the chosen option over the best one's, less 1
};

inline RankingResult rank_options(int scenes, unsigned seed) {
  const auto model = std::make_shared<const RobotModel>(
      RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile"));
  OptionRanker ranker(model);
  RankerSettings fully;
  fully.iterations = fully.first_iterations = 400;
  fully.tolerance = 1e-9;
  OptionRanker converged(model, fully);
  EquivalentTimer timer(1);
  std::set<int> winners;
  RankingResult out;
  std::array<double, kOptions> costs{}, truth{};
  for (; out.scenes < scenes; ++out.scenes) {
    const RankingScene scene = make_ranking_scene(*model, seed + static_cast<unsigned>(out.scenes));
    int best = -1;
    timer.time([&] { best = ranker.rank(scene.x0.data(), 0, scene.options, &scene.field, costs); });
    // The truth: every option on its own to full convergence, or along the row where that found
    // a better motion.
    (void)converged.rank(scene.x0.data(), 0, scene.options, &scene.field, truth);
    for (int i = 0; i < kOptions; ++i) {
      double alone = 0;
      (void)converged.rank(scene.x0.data(), 0, {&scene.options[static_cast<std::size_t>(i)], 1},
                           &scene.field, {&alone, 1});
      truth[static_cast<std::size_t>(i)] = std::min(truth[static_cast<std::size_t>(i)], alone);
    }
    const int truly =
        static_cast<int>(std::min_element(truth.begin(), truth.end()) - truth.begin());
    winners.insert(truly);
    out.agreeing += best == truly;
    if (best >= 0 && truly >= 0)
      out.worst_regret = std::max(out.worst_regret, truth[best] / truth[truly] - 1);
  }
  out.winners = static_cast<int>(winners.size());
  out.options_32_s = 1e-3 * timer.quantile_ms(0.5);
  return out;
}

}  // namespace wb::bench
