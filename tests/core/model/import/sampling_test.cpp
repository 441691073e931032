// Pair sampling, posture search and inverse kinematics, on Mabi-Mobile as its robot.yaml has it.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "core/model/import/posture_search.hpp"

namespace wb {
namespace {

class Sampling : public ::testing::Test {
 protected:
  static RobotConfig config() {
    RobotConfig c = RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile");
    c.base.kind = BaseKind::kFixed;
    return c;
  }
  RobotModel model_{config()};
  SamplingOptions options_{4000, 1};
};

// By brute force: points along both axes.
TEST_F(Sampling, CapsuleDistanceIsThatOfTheirAxes) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> u(-1, 1);
  const auto point = [&] { return Eigen::Vector3d(u(random), u(random), u(random)); };
  RobotModel::Data data;
  data.X_WL[0].setIdentity();
  for (int k = 0; k < 50; ++k) {
    const Capsule a{"a", 0, point(), point(), 0.1};
    const Capsule b{"b", 0, point(), k % 5 ? point() : a.p0, 0.2};
    double nearest = 1e9;
    constexpr int kSteps = 400;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; j <= kSteps; ++j) {
        const Eigen::Vector3d p = a.p0 + (a.p1 - a.p0) * i / kSteps;
        const Eigen::Vector3d q = b.p0 + (b.p1 - b.p0) * j / kSteps;
        nearest = std::min(nearest, (p - q).norm());
      }
    }
    EXPECT_NEAR(capsule_distance(data, a, b), nearest - 0.3, 0.006);
  }
}

TEST_F(Sampling, PairsThatTouchAreKeptAndThoseOfNeighboursAreNoPairs) {
  const std::vector<PairSample> all = sample_pairs(model_, options_);
  const auto of = [&](const std::string& a, const std::string& b) {
    return std::find_if(all.begin(), all.end(), [&](const PairSample& p) {
      return model_.capsules()[p.pair[0]].name == a && model_.capsules()[p.pair[1]].name == b;
    });
  };
  ASSERT_NE(of("tower_left", "arm"), all.end());
  EXPECT_EQ(of("tower_left", "arm")->verdict, PairSample::Verdict::kKept);
  EXPECT_GT(of("tower_left", "arm")->touching, 0.1);
  EXPECT_EQ(of("shoulder", "elbow")->verdict, PairSample::Verdict::kApart);
  EXPECT_EQ(of("forearm", "hand")->verdict, PairSample::Verdict::kAlwaysNear);
  EXPECT_EQ(of("shoulder", "arm"), all.end());
  // What the author of robot.yaml chose as pairs because postures bring them into contact.
  for (const auto& pair : model_.config().self_pairs) {
    const auto p = of(pair[0], pair[1]) != all.end() ? of(pair[0], pair[1]) : of(pair[1], pair[0]);
    ASSERT_NE(p, all.end()) << pair[0] << ", " << pair[1];
    EXPECT_EQ(p->verdict, PairSample::Verdict::kKept) << pair[0] << ", " << pair[1];
  }
}

TEST_F(Sampling, PosturesAreApartWithinLimitsAndAsGoodAsTheHandMadeOnes) {
  const Postures p = find_postures(model_, 0.29, options_);
  ASSERT_TRUE(p.collision_free);
  EXPECT_TRUE(p.path_free);
  for (const std::vector<double>& q : {p.stowed, p.ready}) {
    EXPECT_GE(pair_distance(model_, arm_data(model_, q)), kPairDistance_m);
    for (int j = 0; j < model_.joints(); ++j) {
      EXPECT_GE(q[j], model_.limits(j).lower);
      EXPECT_LE(q[j], model_.limits(j).upper);
    }
  }
  EXPECT_GE(path_distance(model_, p.stowed, p.ready), kPairDistance_m - 1e-3);
  EXPECT_LE(p.stowed_radius_m, radius_about_base(model_, model_.config().stowed) + 0.02);
  const Eigen::Isometry3d X = model_.X_WF(model_.end_effector(), arm_data(model_, p.ready));
  EXPECT_GE(X.linear()(0, 2), 0.999);
  EXPECT_NEAR(X.translation().z(), 0.8, 0.16);
  EXPECT_GE(p.ready_singular_value,
            0.8 * least_singular_value(model_, model_.config().ready, arm_reach(model_)));
}

TEST_F(Sampling, TheSameSeedFindsTheSamePostures) {
  const SamplingOptions few{1000, 7};
  const Postures a = find_postures(model_, 0.29, few), b = find_postures(model_, 0.29, few);
  EXPECT_EQ(a.stowed, b.stowed);
  EXPECT_EQ(a.ready, b.ready);
}

TEST_F(Sampling, InverseKinematicsReachesWhatForwardKinematicsMade) {
  const ArmRange range = arm_range(model_);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(-0.4, 0.4);
  int reached = 0;
  for (int k = 0; k < 40; ++k) {
    std::vector<double> q = model_.config().ready;
    for (std::size_t j = 0; j < q.size(); ++j)
      q[j] = std::clamp(q[j] + u(random), range.lower[j], range.upper[j]);
    const Eigen::Isometry3d goal = model_.X_WF(model_.end_effector(), arm_data(model_, q));
    const IkResult r = solve_ik(model_, range, goal, model_.config().ready);
    const Eigen::Isometry3d X = model_.X_WF(model_.end_effector(), arm_data(model_, r.q));
    reached += (X.translation() - goal.translation()).norm() < 1e-3;
    for (std::size_t j = 0; j < q.size(); ++j) {
      EXPECT_GE(r.q[j], range.lower[j]);
      EXPECT_LE(r.q[j], range.upper[j]);
    }
  }
  EXPECT_GE(reached, 38);
}

}  // namespace
}  // namespace wb
