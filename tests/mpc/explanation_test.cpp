// Explanation: gradients against differences of the rolled-out cost, and situations whose rivals
// are known.
#include "mpc/explanation.hpp"

#include <gtest/gtest.h>

#include "tests/mpc/robot.hpp"

namespace wb::mpc_test {
namespace {

struct Situation {
  std::shared_ptr<const OptimalControlProblem> problem =
      std::make_shared<const OptimalControlProblem>(mabi());
  StateVector x0 = state_at(*mabi(), {0, 0, 0}, mabi()->config().ready);
  Reference reference;
  DistanceField field;
  Policy policy;
  SolveReport report;

  // A policy near the optimum.
  void solve() {
    SlqSolver solver(problem);
    SolveInput input;
    input.x0 = x0.data();
    input.reference = &reference;
    input.field = &field;
    (void)solver.converge(input, 60, 1e-4, policy, report);
  }
  Explanation explained() const {
    return explain(*problem, reference, &field, problem->weights().configured(), policy);
  }
  int index(const std::string& name) const {
    for (std::size_t i = 0; i < problem->terms().size(); ++i) {
      if (problem->terms()[i]->name() == name) return static_cast<int>(i);
    }
    throw std::runtime_error("no term " + name);
  }
  // The hand's pose at x0, moved.
  void reach(const Eigen::Vector3d& by) {
    Eigen::Isometry3d X_WE = end_effector_pose(*mabi(), x0);
    X_WE.translation() += by;
    reference = reach_for(Pose::from(X_WE));
  }
  // A wall half a metre thick, its front `ahead_m` beyond the hand.
  void wall(double ahead_m) {
    const double x = end_effector_pose(*mabi(), x0).translation().x() + ahead_m;
    field = field_of({{{x, -2, 0}, {x + 0.5, 2, 2}}});
  }
};

TEST(Explanation, AGoalInsideAnObstacleIsPulledForAndAgainst) {
  Situation s;
  s.reach({0.4, 0, 0});
  s.wall(0.15);
  s.solve();
  const Explanation e = s.explained();
  ASSERT_FALSE(e.competing.empty());
  const Competition& c = e.competing.front();
  EXPECT_EQ(c.first, s.index("end_effector"));
  EXPECT_EQ(c.second, s.index("environment"));
  EXPECT_LT(c.cosine, -0.9);
  EXPECT_EQ(c.text.find("end_effector pulls against environment (cosine -"), 0u) << c.text;
  EXPECT_NE(c.text.find("close to an obstacle"), std::string::npos) << c.text;
}

TEST(Explanation, AFreeGoalHasNoRivals) {
  for (const double ahead : {0.3, 0.0}) {  // on the way, and there
    Situation s;
    s.reach({ahead, 0, 0});
    s.wall(2.0);
    s.solve();
    const Explanation e = s.explained();
    EXPECT_TRUE(e.competing.empty()) << e.competing.front().text;
  }
}

TEST(Explanation, CostsAreTheSolversAndSharesAddUp) {
  Situation s;
  s.reach({0.4, 0.1, 0});
  s.wall(0.15);
  s.solve();
  const Explanation e = s.explained();
  EXPECT_NEAR(e.cost, s.report.cost_after, 1e-9 * s.report.cost_after);
  double shares = 0;
  for (std::size_t i = 0; i < e.terms.size(); ++i) {
    EXPECT_NEAR(e.terms[i].cost, s.report.terms.cost[i], 1e-9 * (1 + s.report.cost_after));
    EXPECT_NEAR(e.terms[i].violation, s.report.terms.violation[i], 1e-9);
    shares += e.terms[i].share;
  }
  EXPECT_NEAR(shares, 1.0, 1e-12);
}

// d cost / d (input i of node k), by rolling out; the pull is their norm in the header's unit.
TEST(Explanation, PullIsTheGradientOfTheRolledOutCost) {
  Situation s;
  s.reach({0.3, 0.1, -0.1});
  s.wall(2.0);
  s.solve();
  // Away from the optimum, where terms balance.
  for (int k = 0; k + 1 < s.policy.nodes; ++k) s.policy.u(k).array() += 0.05;
  const auto cost = [&](const Policy& p, int term) {
    Node node;
    const Weights weights = s.problem->weights().configured();
    node.reference = &s.reference;
    node.field = &s.field;
    node.weights = weights.values.data();
    StateVector x = p.x(0), next(x.size());
    double sum = 0;
    for (int k = 0; k < p.nodes; ++k) {
      const ReferenceSample at = sample(s.reference, p.t[k]);
      node.sample = &at;
      node.terminal = k + 1 == p.nodes;
      node.x = x;
      if (!node.terminal) node.u = p.u(k);
      TermValues values;
      (void)s.problem->evaluate(node, nullptr, &values);
      sum += s.problem->weight_s(k) * values.cost[term];
      if (node.terminal) break;
      s.problem->step(x.data(), node.u.data(), s.problem->weight_s(k), next.data());
      x = next;
    }
    return sum;
  };
  // The policy's states belong to its inputs.
  for (int k = 0; k + 1 < s.policy.nodes; ++k) {
    s.problem->step(s.policy.x(k).data(), s.policy.u(k).data(), s.problem->weight_s(k),
                    s.policy.x(k + 1).data());
  }
  const Explanation e = s.explained();
  for (const char* name : {"end_effector", "input", "posture"}) {
    const int term = s.index(name);
    double squares = 0;
    constexpr double kStep = 1e-5;
    for (int k = 0; k + 1 < s.policy.nodes; ++k) {
      for (int i = 0; i < s.policy.inputs; ++i) {
        Policy p = s.policy;
        p.u(k)[i] += kStep;
        const double above = cost(p, term);
        p.u(k)[i] -= 2 * kStep;
        const double slope = (above - cost(p, term)) / (2 * kStep);
        const double scaled = slope * s.problem->limits().velocity[i];
        squares += scaled * scaled / s.problem->weight_s(k);
      }
    }
    EXPECT_NEAR(e.terms[term].pull, std::sqrt(squares), 1e-6 * (1 + std::sqrt(squares))) << name;
  }
}

TEST(Explanation, RefusesAnEmptyPolicyAndAnotherRobots) {
  Situation s;
  s.reach({0, 0, 0});
  EXPECT_THROW(s.explained(), std::invalid_argument);
  s.solve();
  s.policy.states = 3;
  EXPECT_THROW(s.explained(), std::invalid_argument);
}

}  // namespace
}  // namespace wb::mpc_test
