// Every registered term of every robot: derivatives against central differences, convexity of the
// Gauss-Newton Hessian, sign.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <map>
#include <set>

#include "bench/mpc_parts/derivative_check.hpp"
#include "mpc/relaxed_barrier.hpp"

namespace wb::mpc_test {
namespace {

constexpr int kSamples = 40;
constexpr double kTolerance = 1e-6;  // relative to the largest entry of a sample's derivatives
constexpr double kKinkShare = 0.15;  // of the entries, see derivative_check.hpp

std::shared_ptr<const OptimalControlProblem> problem_of(const std::string& robot) {
  static std::map<std::string, std::shared_ptr<const OptimalControlProblem>> problems;
  auto& problem = problems[robot];
  if (!problem) problem = std::make_shared<const OptimalControlProblem>(bench::load_robot(robot));
  return problem;
}

using RobotAndTerm = std::pair<std::string, std::string>;

std::vector<RobotAndTerm> robots_and_terms() {
  std::vector<RobotAndTerm> out;
  for (const std::string& robot : bench::robot_names()) {
    for (const auto& term : problem_of(robot)->terms()) out.emplace_back(robot, term->name());
  }
  return out;
}

class Terms : public testing::TestWithParam<RobotAndTerm> {
 protected:
  const std::shared_ptr<const OptimalControlProblem> problem_ = problem_of(GetParam().first);
  bench::Situations situations_{problem_, 7};

  const Term& term() const {
    for (const auto& t : problem_->terms()) {
      if (t->name() == GetParam().second) return *t;
    }
    throw std::out_of_range(GetParam().second);
  }
  double cost(Node& node, Quadratic* quadratic = nullptr) const {
    problem_->model().forward_kinematics(node.x.data(), node.kinematics);
    if (quadratic) quadratic->set_zero(problem_->nx(), problem_->nu());
    return term().evaluate(node, quadratic);
  }
};

TEST_P(Terms, DerivativesMatchCentralDifferences) {
  const bench::DerivativeCheck check =
      bench::check_derivatives(*problem_, term(), situations_, kSamples);
  EXPECT_LE(check.worst, kTolerance);
  EXPECT_LE(check.kinks, kKinkShare * check.entries);
}

TEST_P(Terms, HessianIsSymmetricAndPositiveSemidefinite) {
  Node node;
  const int nx = problem_->nx(), nu = problem_->nu();
  for (int i = 0; i < kSamples; ++i) {
    situations_.randomise(node);
    Quadratic quadratic;
    cost(node, &quadratic);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(nx + nu, nx + nu);
    H.topLeftCorner(nx, nx) = quadratic.Q;
    H.bottomRightCorner(nu, nu) = quadratic.R;
    if (quadratic.coupled) {
      H.bottomLeftCorner(nu, nx) = quadratic.P;
      H.topRightCorner(nx, nu) = quadratic.P.transpose();
    }
    const double scale = 1.0 + H.norm();
    EXPECT_LE((H - H.transpose()).norm(), 1e-12 * scale);
    EXPECT_GE(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(H).eigenvalues().minCoeff(),
              -1e-12 * scale);
  }
}

TEST_P(Terms, CostIsNeverNegativeAndDoesNotDependOnDerivativesBeingAsked) {
  Node node;
  for (int i = 0; i < kSamples; ++i) {
    situations_.randomise(node);
    Quadratic quadratic;
    const double alone = cost(node);
    EXPECT_GE(alone, 0.0);
    EXPECT_DOUBLE_EQ(alone, cost(node, &quadratic));
  }
}

TEST_P(Terms, NotANumberShows) {
  if (GetParam().second == "base_route" && problem_->model().base_dof() == 0)
    return;  // a fixed base follows nothing
  Node node;
  situations_.randomise(node);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  node.x.setConstant(kNan);
  node.u.setConstant(kNan);
  DistanceField spoilt = situations_.field();  // the field clamps positions
  const auto& [nx, ny, nz] = spoilt.size();
  std::fill_n(spoilt.data(), nx * ny * nz, static_cast<float>(kNan));
  node.field = &spoilt;
  if (term().kind() == TermKind::kEquality) {
    Equality rows;
    problem_->model().forward_kinematics(node.x.data(), node.kinematics);
    term().constrain(node, rows, false);
    EXPECT_TRUE(std::isnan(rows.e[0]));
  } else {
    EXPECT_TRUE(std::isnan(cost(node)));
  }
}

INSTANTIATE_TEST_SUITE_P(Registry, Terms, testing::ValuesIn(robots_and_terms()),
                         [](const auto& info) {
                           return info.param.first + "_" + info.param.second;
                         });

// A heavy base never tips, a strong arm bears everything: not every robot exercises every term.
TEST(TermRegistry, EveryTermIsExercisedBySomeRobot) {
  std::map<std::string, int> effects;
  for (const std::string& robot : bench::robot_names()) {
    const auto problem = problem_of(robot);
    bench::Situations situations(problem, 7);
    for (const auto& term : problem->terms())
      effects[term->name()] +=
          bench::check_derivatives(*problem, *term, situations, kSamples).samples_with_effect;
  }
  for (const auto& [name, count] : effects) EXPECT_GE(count, 1) << name;
}

TEST(TermRegistry, NamesAreUnique) {
  for (const std::string& robot : bench::robot_names()) {
    std::set<std::string> names;
    for (const auto& term : problem_of(robot)->terms())
      EXPECT_TRUE(names.insert(term->name()).second) << term->name();
  }
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
