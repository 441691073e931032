// Every registered term: derivatives against central differences, convexity of the Gauss-Newton
// Hessian, sign.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <set>

#include "mpc/relaxed_barrier.hpp"
#include "tests/mpc/robot.hpp"

namespace wb::mpc_test {
namespace {

constexpr int kSamples = 60;
// Central differences with step h are off by h^2 f''' / 6 + eps f / h; the barriers' third
// derivatives reach 1e5.
constexpr double kStep = 1e-6;
constexpr double kTolerance = 2e-5;
// A sample counts as a kink where differences on either side disagree by this much more than
// curvature explains.
constexpr double kKinkShare = 0.10;

// A random situation in which every term of the list has something to say.
struct Situation {
  Reference reference;
  ReferenceSample sample;
  Node node;
};

class Terms : public testing::TestWithParam<std::string> {
 protected:
  static const OptimalControlProblem& problem() {
    static const OptimalControlProblem instance(mabi());
    return instance;
  }
  static const DistanceField& field() {
    static const DistanceField instance =
        field_of({{{0.3, -0.6, 0.0}, {0.9, 0.1, 0.8}}, {{-1, 0.6, 0}, {1, 1, 2}}});
    return instance;
  }
  const Term& term() const {
    for (const auto& t : problem().terms()) {
      if (t->name() == GetParam()) return *t;
    }
    throw std::out_of_range(GetParam());
  }

  void randomise(Situation& s) {
    const RobotModel& model = problem().model();
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random_);
    };
    s.reference = {};
    s.reference.joint_count = model.joints();
    s.reference.ee_count = s.reference.base_count = 1;
    s.reference.speed_scale = uniform(0.2, 1.0);
    s.reference.ee_position_scale = uniform(0, 2);
    s.reference.ee_orientation_scale = uniform(0, 2);
    s.reference.base_scale = uniform(0, 2);
    s.reference.masks[0].active = uniform(0, 1) < 0.5;
    s.reference.masks[0].X_WM = Pose{{0.6, -0.25, 0.4}, {0, 0, 0, 1}};
    s.reference.masks[0].half_extent = {0.3, 0.35, 0.4};
    for (double& q : s.reference.posture) q = uniform(-1, 1);
    Eigen::Quaterniond q(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
    s.reference.ee[0].X_WE =
        Pose::from({uniform(-1, 1), uniform(-1, 1), uniform(0, 1)}, q.normalized());
    s.reference.base[0].base = {uniform(-1, 1), uniform(-1, 1), uniform(-6, 6)};
    s.sample = sample(s.reference, 0);
    s.node.reference = &s.reference;
    s.node.sample = &s.sample;
    s.node.field = &field();
    s.node.x.resize(model.nx());
    s.node.x.head<3>() << uniform(-0.4, 0.4), uniform(-0.4, 0.4), uniform(-3, 3);
    for (int j = 0; j < model.joints(); ++j) {
      const double reach = model.limits(j).upper - model.limits(j).lower;
      s.node.x[3 + j] = model.limits(j).lower + uniform(-0.02, 1.02) * reach;
    }
    s.node.u.resize(model.nu());
    for (int i = 0; i < model.nu(); ++i) {
      s.node.u[i] = uniform(-1.1, 1.1) * s.reference.speed_scale * problem().limits().velocity[i];
    }
  }

  double cost(Node& node, Quadratic* quadratic = nullptr) const {
    problem().model().forward_kinematics(node.x.data(), node.kinematics);
    if (quadratic) quadratic->set_zero(problem().nx(), problem().nu());
    return term().evaluate(node, quadratic);
  }

  // Compares one entry of a gradient; returns false where the cost has a kink within the step.
  bool slope_agrees(Node& node, double& variable, double gradient) const {
    const double at = variable, middle = cost(node);
    variable = at + kStep;
    const double ahead = cost(node);
    variable = at - kStep;
    const double behind = cost(node);
    variable = at;
    const double right = (ahead - middle) / kStep, left = (middle - behind) / kStep;
    const double scale = 1.0 + std::abs(right) + std::abs(left);
    // One-sided slopes differ by curvature times the step, and curvature stays below 1e4 per unit
    // of scale.
    if (std::abs(right - left) > 0.02 * scale) return false;
    EXPECT_NEAR(gradient, 0.5 * (right + left), kTolerance * scale);
    return true;
  }

  std::mt19937 random_{7};
};

TEST_P(Terms, GradientMatchesCentralDifferences) {
  Situation s;
  int entries = 0, kinks = 0, nonzero = 0;
  for (int i = 0; i < kSamples; ++i) {
    randomise(s);
    Quadratic quadratic;
    cost(s.node, &quadratic);
    nonzero += quadratic.q.norm() + quadratic.r.norm() > 0;
    for (int r = 0; r < problem().nx(); ++r, ++entries)
      kinks += !slope_agrees(s.node, s.node.x[r], quadratic.q[r]);
    for (int r = 0; r < problem().nu(); ++r, ++entries)
      kinks += !slope_agrees(s.node, s.node.u[r], quadratic.r[r]);
  }
  EXPECT_GT(nonzero, kSamples / 10) << "the samples do not exercise the term";
  EXPECT_LE(kinks, kKinkShare * entries);
}

TEST_P(Terms, HessianIsSymmetricAndPositiveSemidefinite) {
  Situation s;
  for (int i = 0; i < kSamples; ++i) {
    randomise(s);
    Quadratic quadratic;
    cost(s.node, &quadratic);
    const auto check = [](const Eigen::MatrixXd& H) {
      const double scale = 1.0 + H.norm();
      EXPECT_LE((H - H.transpose()).norm(), 1e-12 * scale);
      EXPECT_GE(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(H).eigenvalues().minCoeff(),
                -1e-12 * scale);
    };
    check(quadratic.Q);
    check(quadratic.R);
  }
}

TEST_P(Terms, CostIsNeverNegativeAndDoesNotDependOnDerivativesBeingAsked) {
  Situation s;
  for (int i = 0; i < kSamples; ++i) {
    randomise(s);
    Quadratic quadratic;
    const double alone = cost(s.node);
    EXPECT_GE(alone, 0.0);
    EXPECT_DOUBLE_EQ(alone, cost(s.node, &quadratic));
  }
}

TEST_P(Terms, NotANumberShowsInTheCost) {
  Situation s;
  randomise(s);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  s.node.x.setConstant(kNan);
  s.node.u.setConstant(kNan);
  DistanceField spoilt = field();  // the environment's part: the field clamps positions
  const auto& [nx, ny, nz] = spoilt.size();
  std::fill_n(spoilt.data(), nx * ny * nz, static_cast<float>(kNan));
  s.node.field = &spoilt;
  EXPECT_TRUE(std::isnan(cost(s.node)));
}

std::vector<std::string> names() {
  const OptimalControlProblem problem(mabi());
  std::vector<std::string> out;
  for (const auto& term : problem.terms()) out.push_back(term->name());
  return out;
}
INSTANTIATE_TEST_SUITE_P(Registry, Terms, testing::ValuesIn(names()),
                         [](const auto& info) { return info.param; });

TEST(TermRegistry, NamesAreUnique) {
  const std::vector<std::string> all = names();
  EXPECT_EQ(std::set<std::string>(all.begin(), all.end()).size(), all.size());
}

TEST(RelaxedBarrier, ValueSlopeAndCurvatureAreContinuous) {
  const RelaxedBarrier barrier{0.7, 0.05, 0.4};
  constexpr double kGap = 1e-9;
  for (const double z : {barrier.delta, barrier.reach}) {
    const auto below = barrier.at(z - kGap), above = barrier.at(z + kGap);
    EXPECT_NEAR(below.value, above.value, 1e-6);
    EXPECT_NEAR(below.slope, above.slope, 1e-5);
    EXPECT_NEAR(below.curvature, above.curvature, 1e-4);
  }
}

TEST(RelaxedBarrier, IsTheLogarithmNearZeroAndNothingBeyondItsReach) {
  const RelaxedBarrier barrier{2.0, 1e-4, 1.0};
  // -ln s + ln(s / 2) = -ln 2, up to the fading polynomial's change of (3/2 s) between the two
  // points.
  EXPECT_NEAR(barrier.at(1e-3).value - barrier.at(2e-3).value, 2.0 * std::log(2.0), 2.0 * 2e-3);
  EXPECT_EQ(barrier.at(1.0).value, 0.0);
  EXPECT_EQ(barrier.at(5.0).slope, 0.0);
}

}  // namespace
}  // namespace wb::mpc_test
