// Grid, model of motion, reference sampling, configuration errors, and what a Policy's evaluation
// means.
#include <gtest/gtest.h>

#include <fstream>
#include <regex>
#include <sstream>

#include "tests/mpc/robot.hpp"

namespace wb::mpc_test {
namespace {

std::string mpc_yaml() {
  std::ifstream in(WB_SOURCE_DIR "/config/robots/mabi_mobile/mpc.yaml");
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::string error_of(const std::string& text) {
  try {
    OptimalControlProblem problem(mabi(), config::Section::parse(text, "mpc.yaml"));
  } catch (const config::ConfigError& e) {
    return e.what();
  }
  return "";
}

TEST(OptimalControlProblem, GridIsFineInTheFirstSecondAndCoarseUntilTheHorizon) {
  const OptimalControlProblem problem(mabi());
  const auto grid = problem.grid();
  EXPECT_EQ(grid.front(), 0.0);
  EXPECT_DOUBLE_EQ(grid.back(), 4.0);
  constexpr double kRounding = 1e-12;
  for (std::size_t i = 0; i + 1 < grid.size(); ++i) {
    EXPECT_LE(grid[i + 1] - grid[i], (grid[i] < 1.0 - kRounding ? 0.04 : 0.1) + kRounding);
    EXPECT_GT(grid[i + 1], grid[i]);
  }
}

TEST(OptimalControlProblem, ConfigurationErrorsNameFileAndKey) {
  const std::string good = mpc_yaml();
  EXPECT_EQ(error_of(good), "");
  const std::string unknown =
      error_of(std::regex_replace(good, std::regex("reach_m:"), "reech_m:"));
  EXPECT_NE(unknown.find("mpc.yaml"), std::string::npos);
  EXPECT_NE(unknown.find("terms.self_collision.reach_m"), std::string::npos);
  EXPECT_NE(error_of(std::regex_replace(good, std::regex("coarse_step_s: [0-9.]+"),
                                        "coarse_step_s: 0.001"))
                .find("nodes"),
            std::string::npos);
  EXPECT_NE(error_of(std::regex_replace(good, std::regex("mu_pm2: [0-9.]+"), "mu_pm2: -1"))
                .find("allowed"),
            std::string::npos);
}

TEST(OptimalControlProblem, DisabledTermsAreLeftOutAndUnknownOnesRefused) {
  const OptimalControlProblem problem(mabi(), {"environment"});
  for (const auto& term : problem.terms()) EXPECT_NE(term->name(), "environment");
  EXPECT_EQ(problem.terms().size() + 1, OptimalControlProblem(mabi()).terms().size());
  EXPECT_THROW(OptimalControlProblem(mabi(), {"enviroment"}), config::ConfigError);
}

// Mabi-Mobile, and the same robot on a base that can move sideways.
class MotionOf : public ::testing::TestWithParam<BaseKind> {
 protected:
  static std::shared_ptr<const RobotModel> robot() {
    RobotConfig config = mabi_config();
    config.base.kind = GetParam();
    return std::make_shared<const RobotModel>(config);
  }
  const OptimalControlProblem problem{robot()};
  const int turn = problem.model().base_inputs() - 1;
};
INSTANTIATE_TEST_SUITE_P(Bases, MotionOf,
                         ::testing::Values(BaseKind::kDifferentialDrive,
                                           BaseKind::kOmnidirectional));

TEST(OptimalControlProblem, AnOmnidirectionalBasesTwoAxesShareLimitsAndWeight) {
  RobotConfig config = mabi_config();
  config.base.kind = BaseKind::kOmnidirectional;
  const OptimalControlProblem problem(std::make_shared<const RobotModel>(config));
  EXPECT_EQ(problem.nx(), 9);
  EXPECT_EQ(problem.nu(), 9);
  const InputVector& fastest = problem.limits().velocity;
  EXPECT_EQ(fastest[0], config.base.velocity_max);
  EXPECT_EQ(fastest[1], config.base.velocity_max);
  EXPECT_EQ(fastest[2], config.base.yaw_rate_max);
  EXPECT_EQ(fastest[3], problem.model().limits(0).velocity);
  const InputVector& hardest = problem.limits().acceleration;
  EXPECT_EQ(hardest[1], config.base.acceleration_max);
  EXPECT_EQ(hardest[2], config.base.yaw_acceleration_max);
  Node node;
  const Reference reference;
  const Weights weights = problem.weights().configured();
  node.reference = &reference;
  node.weights = weights.values.data();
  node.x.setZero(problem.nx());
  const auto effort = [&](int row) {
    node.u.setZero(problem.nu());
    node.u[row] = 0.1;
    return problem.terms()[0]->evaluate(node, nullptr);
  };
  ASSERT_EQ(problem.terms()[0]->name(), "input");
  EXPECT_EQ(effort(0), effort(1));
  EXPECT_NE(effort(1), effort(2));
}

TEST_P(MotionOf, StepIsTheExactIntegral) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int sample = 0; sample < 20; ++sample) {
    StateVector x(problem.nx()), fine(problem.nx()), coarse(problem.nx());
    InputVector u(problem.nu());
    for (int i = 0; i < x.size(); ++i) x[i] = 3 * uniform(random);
    for (int i = 0; i < u.size(); ++i)
      u[i] = uniform(random) * (sample % 3 == 0 && i == turn ? 1e-7 : 1.0);
    const double vx = u[0], vy = turn == 2 ? u[1] : 0.0;
    constexpr int kParts = 20000;
    constexpr double kDt = 0.5;
    fine = x;
    for (int i = 0; i < kParts; ++i) {  // midpoint rule, error below kDt^3 / kParts^2
      const double yaw = fine[2] + 0.5 * u[turn] * kDt / kParts;
      fine[0] += (std::cos(yaw) * vx - std::sin(yaw) * vy) * kDt / kParts;
      fine[1] += (std::sin(yaw) * vx + std::cos(yaw) * vy) * kDt / kParts;
      for (int r = turn; r < u.size(); ++r) fine[r + 2 - turn] += u[r] * kDt / kParts;
    }
    problem.step(x.data(), u.data(), kDt, coarse.data());
    EXPECT_LE((fine - coarse).norm(), 1e-9);
  }
}

TEST_P(MotionOf, StepDerivativesMatchCentralDifferences) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> uniform(-1, 1);
  constexpr double kStep = 1e-6, kTolerance = 1e-8;  // step^2 + rounding / step
  for (int sample = 0; sample < 30; ++sample) {
    StateVector x(problem.nx()), ahead(problem.nx()), behind(problem.nx());
    InputVector u(problem.nu());
    for (int i = 0; i < x.size(); ++i) x[i] = 3 * uniform(random);
    for (int i = 0; i < u.size(); ++i) u[i] = uniform(random);
    if (sample % 3 == 0) u[turn] = 0.0;    // straight
    if (sample % 3 == 1) u[turn] *= 1e-3;  // the series
    StateMatrix A;
    StateInputMatrix B;
    problem.step_derivatives(x.data(), u.data(), 0.1, A, B);
    const auto check = [&](double& variable, const Eigen::VectorXd& column) {
      const double at = variable;
      variable = at + kStep;
      problem.step(x.data(), u.data(), 0.1, ahead.data());
      variable = at - kStep;
      problem.step(x.data(), u.data(), 0.1, behind.data());
      variable = at;
      EXPECT_LE(((ahead - behind) / (2 * kStep) - column).norm(), kTolerance);
    };
    for (int i = 0; i < x.size(); ++i) check(x[i], A.col(i));
    for (int i = 0; i < u.size(); ++i) check(u[i], B.col(i));
  }
}

TEST(ReferenceSample, InterpolatesBetweenKeyframesAndHoldsOutside) {
  Reference reference;
  reference.ee[0].count = reference.base_count = 2;
  reference.ee[0].keyframes[0] = {100, Pose::from({0, 0, 0}, Eigen::Quaterniond::Identity())};
  reference.ee[0].keyframes[1] = {
      200,
      Pose::from({1, 2, 3}, Eigen::Quaterniond(Eigen::AngleAxisd(1.0, Eigen::Vector3d::UnitX())))};
  reference.base[0] = {100, {0, 0, 3}};
  reference.base[1] = {200, {1, -1, 4}};  // yaw is continuous: no wrapping on the way
  constexpr double kRounding = 1e-14;
  const ReferenceSample middle = sample(reference, 125);
  EXPECT_LE((middle.ee[0].p_WE - Eigen::Vector3d(0.25, 0.5, 0.75)).norm(), kRounding);
  EXPECT_NEAR(Eigen::AngleAxisd(middle.ee[0].R_WE).angle(), 0.25, 1e-12);
  EXPECT_LE((middle.base - Eigen::Vector3d(0.25, -0.25, 3.25)).norm(), kRounding);
  EXPECT_EQ(sample(reference, 0).base[2], 3.0);
  EXPECT_EQ(sample(reference, 999).ee[0].p_WE.z(), 3.0);
  EXPECT_FALSE(sample(Reference{}, 0).ee[0].active);
  EXPECT_FALSE(sample(Reference{}, 0).has_base);
}

TEST(ReferenceSample, QuaternionOfLengthZeroIsNotTakenForARotation) {
  Reference reference;
  reference.ee[0].count = 1;
  reference.ee[0].keyframes[0].X_WE.q = {0, 0, 0, 0};
  EXPECT_FALSE(sample(reference, 0).ee[0].R_WE.allFinite());
}

// Two states, one input, nodes at 0, 100 and 300 ns.
Policy small_policy() {
  Policy p;
  p.nodes = 3;
  p.states = 2;
  p.inputs = 1;
  p.t[0] = 0, p.t[1] = 100, p.t[2] = 300;
  p.x(0) << 0, 0;
  p.x(1) << 1, 10;
  p.x(2) << 3, 30;
  p.u(0) << 5;
  p.u(1) << 7;
  p.K(0) << 1, 2;
  p.K(1) << 3, 4;
  return p;
}

TEST(Policy, InputAndGainOfANodeActUntilTheNextOneOnTheInterpolatedState) {
  const Policy p = small_policy();
  double u = 0, x_ref[2];
  const double x[2] = {0.5, 6.0};
  ASSERT_TRUE(p.evaluate(50, x, &u, x_ref));
  EXPECT_EQ(x_ref[0], 0.5);
  EXPECT_EQ(x_ref[1], 5.0);
  EXPECT_EQ(u, 5 + 2 * (6.0 - 5.0));
  ASSERT_TRUE(p.evaluate(100, x, &u, x_ref));  // at a node its own input and gain
  EXPECT_EQ(u, 7 + 3 * (0.5 - 1) + 4 * (6.0 - 10));
}

TEST(Policy, BeforeTheFirstNodeTheFirstHoldsAndFromTheLastOnNothingMoves) {
  const Policy p = small_policy();
  double u = 0, x_ref[2];
  const double x[2] = {0, 0};
  ASSERT_TRUE(p.evaluate(-50, x, &u, x_ref));
  EXPECT_EQ(u, 5.0);
  EXPECT_EQ(x_ref[1], 0.0);
  EXPECT_FALSE(p.evaluate(300, x, &u, x_ref));
  EXPECT_EQ(u, 0.0);
  EXPECT_EQ(x_ref[1], 30.0);
  EXPECT_FALSE(Policy{}.evaluate(0, x, &u, x_ref));
}

}  // namespace
}  // namespace wb::mpc_test
