// The solver call by call: what it promises of every policy, whatever it is handed.
#include <gtest/gtest.h>

#include <fstream>
#include <regex>
#include <sstream>

#include "core/rt/allocation_count.hpp"
#include "tests/mpc/robot.hpp"

namespace wb::mpc_test {
namespace {

constexpr TimeNs kPeriod = kNanosPerSecond / 30;

std::shared_ptr<const OptimalControlProblem> mobile() {
  static const auto problem = std::make_shared<const OptimalControlProblem>(mabi());
  return problem;
}

// The same arm bolted to the floor; run-time sized solver paths are covered by riccati_test.
std::shared_ptr<const OptimalControlProblem> fixed() {
  RobotConfig config = mabi_config();
  config.base.kind = BaseKind::kFixed;
  std::ifstream in(config.folder / "mpc.yaml");
  std::ostringstream text;
  text << in.rdbuf();
  std::string yaml = std::regex_replace(text.str(), std::regex("    base_[a-z0-9_]+: .*\n"), "");
  yaml = std::regex_replace(yaml, std::regex("base_route: \\{.*\\}"), "base_route: {}");
  return std::make_shared<const OptimalControlProblem>(std::make_shared<const RobotModel>(config),
                                                       config::Section::parse(yaml, "mpc.yaml"));
}

StateVector ready(const RobotModel& model) {
  return state_at(model, {0, 0, 0}, model.config().ready);
}

Reference reach_ahead(const RobotModel& model, double x, double y, double z) {
  Eigen::Isometry3d X = end_effector_pose(model, ready(model));
  X.translation() += Eigen::Vector3d(x, y, z);
  return reach_for(Pose::from(X));
}

// A solver with everything it needs, called once a period along its own prediction.
struct Session {
  explicit Session(std::shared_ptr<const OptimalControlProblem> p)
      : problem(std::move(p)),
        solver(problem),
        policy(std::make_unique<Policy>()),
        x(ready(problem->model())) {}

  SolveStatus solve(const Reference& reference, const DistanceField* field = nullptr) {
    return solver.solve({t, x.data(), &reference, field}, *policy, report);
  }
  void advance() {
    StateVector next(x.size());
    problem->step(x.data(), policy->u(0).data(), to_seconds(kPeriod), next.data());
    x = next;
    t += kPeriod;
  }

  std::shared_ptr<const OptimalControlProblem> problem;
  SlqSolver solver;
  std::unique_ptr<Policy> policy;
  SolveReport report;
  StateVector x;
  TimeNs t = 0;
};

bool finite(const Policy& p) {
  for (int i = 0; i < p.nodes; ++i) {
    if (!p.x(i).allFinite()) return false;
    if (i + 1 < p.nodes && !(p.u(i).allFinite() && p.K(i).allFinite())) return false;
  }
  return p.nodes > 1;
}

TEST(SlqSolver, CallsFromOneStateNeverRaiseTheCostAndSettle) {
  Session s(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.3, 0.2, 0.1);
  double last = std::numeric_limits<double>::infinity();
  double change = 0;
  for (int call = 0; call < 40; ++call) {
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
    EXPECT_LE(s.report.cost_after, s.report.cost_before * (1 + 1e-9));
    change = last - s.report.cost_after;
    last = s.report.cost_after;
  }
  EXPECT_LE(std::abs(change), 1e-3 * last);
}

TEST(SlqSolver, TermCostsAddUpToTheCost) {
  Session s(mobile());
  ASSERT_EQ(s.solve(reach_ahead(mobile()->model(), 0.3, 0, 0)), SolveStatus::kConverging);
  double sum = 0;
  for (const double c : s.report.terms.cost) sum += c;
  EXPECT_NEAR(sum, s.report.cost_after, 1e-12 * (1 + sum) * s.report.nodes);
}

TEST(SlqSolver, PolicyObeysTheModelOfMotion) {
  Session s(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.5, -0.4, 0.1);
  for (int call = 0; call < 20; ++call, s.advance()) {
    ASSERT_EQ(s.solve(reference), SolveStatus::kConverging);
    EXPECT_EQ(s.report.defect, 0.0);
    for (int i = 0; i + 1 < s.policy->nodes; ++i) {
      StateVector next(s.x.size());
      s.problem->step(s.policy->x(i).data(), s.policy->u(i).data(), s.problem->weight_s(i),
                      next.data());
      EXPECT_LE((next - s.policy->x(i + 1)).norm(), 1e-12);
    }
  }
}

TEST(SlqSolver, RatesNeverExceedTheirScaledLimits) {
  Session s(mobile());
  Reference reference =
      reach_ahead(mobile()->model(), 3.0, 2.0, 0.5);  // out of reach: every limit is pressed
  int at_limit = 0;
  for (int call = 0; call < 90; ++call, s.advance()) {
    reference.speed_scale = call < 60 ? 1.0 : 0.3;  // slows down in full motion
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
    for (int i = 0; i + 1 < s.policy->nodes; ++i) {
      for (int r = 0; r < s.problem->nu(); ++r) {
        const double limit = reference.speed_scale * s.problem->limits().velocity[r];
        EXPECT_LE(std::abs(s.policy->u(i)[r]), limit);
        at_limit += std::abs(s.policy->u(i)[r]) > 0.95 * limit;
      }
    }
  }
  EXPECT_GT(at_limit, 100) << "the limits were never pressed";
}

TEST(SlqSolver, InputsAreWithinReachOfTheAppliedOneByTheAccelerationLimits) {
  Session s(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 1.0, 0.5, 0.2);
  InputVector applied = InputVector::Zero(s.problem->nu());
  constexpr double kRounding = 1e-12;
  for (int call = 0; call < 60; ++call) {
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
    for (int i = 0; i + 1 < s.policy->nodes; ++i) {
      for (int r = 0; r < s.problem->nu(); ++r) {
        const double change =
            s.problem->solver().acceleration_fraction * s.problem->limits().acceleration[r] *
            (s.problem->grid()[i] + s.problem->grid()[1]);  // a call is due before node 1
        EXPECT_LE(std::abs(s.policy->u(i)[r] - applied[r]), change + kRounding);
      }
    }
    s.advance();
    StateVector x_ref(s.x.size());
    ASSERT_TRUE(s.policy->evaluate(s.t, s.x.data(), applied.data(), x_ref.data()));
  }
}

TEST(SlqSolver, TermsWithoutAReferenceCostNothing) {
  Session s(mobile());
  ASSERT_NE(s.solve(Reference{}), SolveStatus::kNotFinite);
  const auto terms = s.problem->terms();
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const std::string& name = terms[i]->name();
    if (name == "end_effector" || name == "base_route" || name == "posture" ||
        name == "environment") {
      EXPECT_EQ(s.report.terms.cost[i], 0.0) << name;
    }
  }
}

// Each spoils one part of an input that was fine.
struct Spoiler {
  const char* name;
  void (*spoil)(StateVector& x, Reference& reference, DistanceField& field);
};
class SlqSolverNotFinite : public testing::TestWithParam<Spoiler> {};

TEST_P(SlqSolverNotFinite, YieldsTheLastPolicyShifted) {
  Session s(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.3, 0.2, 0.0);
  const DistanceField field = field_of({{{0.4, -0.5, 0.0}, {1.6, 0.5, 0.9}}});
  for (int call = 0; call < 5; ++call, s.advance()) {
    ASSERT_NE(s.solve(reference, &field), SolveStatus::kNotFinite);
  }
  const auto good = std::make_unique<Policy>(*s.policy);
  StateVector x = s.x;
  Reference bad = reference;
  DistanceField bad_field = field;
  GetParam().spoil(x, bad, bad_field);
  EXPECT_EQ(s.solver.solve({s.t, x.data(), &bad, &bad_field}, *s.policy, s.report),
            SolveStatus::kNotFinite);
  ASSERT_TRUE(finite(*s.policy));
  EXPECT_EQ(s.policy->t_ns, s.t);
  StateVector x_ref(s.x.size());
  InputVector u(s.problem->nu());
  for (int i = 0; i < s.policy->nodes; ++i) {  // past its end the last state holds
    EXPECT_EQ(good->evaluate(s.policy->t[i], s.x.data(), u.data(), x_ref.data()),
              s.policy->t[i] < good->t[good->nodes - 1]);
    EXPECT_LE((s.policy->x(i) - x_ref).norm(), 1e-12);
  }
  // And it recovers with the next good input.
  EXPECT_NE(s.solve(reference, &field), SolveStatus::kNotFinite);
}

TEST_P(SlqSolverNotFinite, YieldsStandstillWithoutALastPolicy) {
  Session s(mobile());
  Reference reference = reach_ahead(mobile()->model(), 0.3, 0.2, 0.0);
  DistanceField field = field_of({{{0.4, -0.5, 0.0}, {1.6, 0.5, 0.9}}});
  GetParam().spoil(s.x, reference, field);
  EXPECT_EQ(s.solve(reference, &field), SolveStatus::kNotFinite);
  ASSERT_TRUE(finite(*s.policy));
  for (int i = 0; i + 1 < s.policy->nodes; ++i) EXPECT_EQ(s.policy->u(i).norm(), 0.0);
}

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
INSTANTIATE_TEST_SUITE_P(
    Spoilt, SlqSolverNotFinite,
    testing::Values(
        Spoiler{"BaseYaw", [](StateVector& x, Reference&, DistanceField&) { x[2] = kNan; }},
        Spoiler{"JointInfinite",
                [](StateVector& x, Reference&, DistanceField&) { x[5] = 1.0 / 0.0; }},
        Spoiler{"Goal", [](StateVector&, Reference& r,
                           DistanceField&) { r.ee[0].keyframes[0].X_WE.p[1] = kNan; }},
        Spoiler{"GoalOverflows", [](StateVector&, Reference& r,
                                    DistanceField&) { r.ee[0].keyframes[0].X_WE.p[1] = 1e200; }},
        Spoiler{"Quaternion",
                [](StateVector&, Reference& r, DistanceField&) {
                  r.ee[0].keyframes[0].X_WE.q = {0, 0, 0, 0};
                }},
        Spoiler{"Scale",
                [](StateVector&, Reference& r, DistanceField&) { r.ee[0].position_scale = kNan; }},
        Spoiler{"SpeedScale",
                [](StateVector&, Reference& r, DistanceField&) { r.speed_scale = kNan; }},
        Spoiler{"SpeedScaleZero",
                [](StateVector&, Reference& r, DistanceField&) { r.speed_scale = 0; }},
        Spoiler{"Field",
                [](StateVector&, Reference&, DistanceField& f) {
                  std::fill_n(f.data(), 120 * 120 * 40, static_cast<float>(kNan));
                }}),
    [](const auto& info) { return info.param.name; });

TEST(SlqSolver, ResetForgetsTheWarmStart) {
  Session s(mobile()), fresh(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.3, 0.2, 0.0);
  for (int call = 0; call < 5; ++call) ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
  s.solver.reset();
  ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
  ASSERT_NE(fresh.solve(reference), SolveStatus::kNotFinite);
  EXPECT_EQ(s.report.cost_after, fresh.report.cost_after);
  EXPECT_EQ(s.policy->x_data, fresh.policy->x_data);
}

TEST(SlqSolver, SameInputsGiveTheSameBits) {
  const DistanceField field = field_of({{{0.9, -0.5, 0.0}, {1.6, 0.5, 0.9}}});
  Session a(mobile()), b(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.6, 0.3, 0.0);
  for (int call = 0; call < 30; ++call, a.advance(), b.advance()) {
    ASSERT_EQ(a.solve(reference, &field), b.solve(reference, &field));
    ASSERT_EQ(a.policy->x_data, b.policy->x_data);
    ASSERT_EQ(a.policy->u_data, b.policy->u_data);
    ASSERT_EQ(a.policy->k_data, b.policy->k_data);
  }
}

TEST(SlqSolver, SolvingAllocatesNothing) {
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns malloc";
  const DistanceField field = field_of({{{0.9, -0.5, 0.0}, {1.6, 0.5, 0.9}}});
  for (const auto& problem : {mobile(), fixed()}) {
    Session s(problem);
    Reference reference = reach_ahead(problem->model(), 0.5, 0.3, 0.0);
    for (int call = 0; call < 40; ++call, s.advance()) {
      if (call == 20) reference.ee[0].keyframes[0].X_WE.p[0] = kNan;  // the fallback too
      const std::uint64_t before = thread_allocations();
      const SolveStatus status = s.solve(reference, &field);
      EXPECT_EQ(thread_allocations(), before);
      EXPECT_EQ(status == SolveStatus::kNotFinite, call >= 20);
    }
  }
}

TEST(SlqSolver, FixedArmReachesAGoal) {
  const auto problem = fixed();
  Session s(problem);
  StateVector there = s.x;
  there.head<2>() += Eigen::Vector2d(-0.25, 0.25);
  const Reference reference = reach_for(Pose::from(end_effector_pose(problem->model(), there)));
  for (int call = 0; call < 150; ++call, s.advance())
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
  const Eigen::Vector3d p_WE = end_effector_pose(problem->model(), s.x).translation();
  EXPECT_LE((p_WE - reference.ee[0].keyframes[0].X_WE.position()).norm(), 2e-3);
}

TEST(SlqSolver, ABadEndOfTheHorizonShortensIt) {
  Session s(mobile());
  Reference reference = reach_ahead(mobile()->model(), 0.3, 0.2, 0.0);
  reference.ee[0].count = 3;
  reference.ee[0].keyframes[1] = reference.ee[0].keyframes[2] = reference.ee[0].keyframes[0];
  reference.ee[0].keyframes[1].t_ns = from_seconds(2.0);
  reference.ee[0].keyframes[2].t_ns = from_seconds(3.0);
  reference.ee[0].keyframes[2].X_WE.p[0] = kNan;
  EXPECT_EQ(s.solve(reference), SolveStatus::kShortened);
  EXPECT_EQ(s.policy->quality, PolicyQuality::kShortened);
  ASSERT_TRUE(finite(*s.policy));
  EXPECT_LT(to_seconds(s.policy->t[s.policy->nodes - 1]), 2.0 + 1e-9);
  EXPECT_GT(to_seconds(s.policy->t[s.policy->nodes - 1]), 1.5);
  EXPECT_EQ(s.report.trouble.kind, TroubleKind::kReference);
  EXPECT_EQ(s.solver.counters().shortened, 1u);
}

TEST(SlqSolver, TroubleNamesTermAndState) {
  Session s(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.3, 0.2, 0.0);
  DistanceField field = field_of({{{0.4, -0.5, 0.0}, {1.6, 0.5, 0.9}}});
  std::fill_n(field.data(), 120 * 120 * 40, static_cast<float>(kNan));
  EXPECT_EQ(s.solve(reference, &field), SolveStatus::kNotFinite);
  EXPECT_EQ(s.policy->quality, PolicyQuality::kKept);
  EXPECT_NE(describe(*mobile(), s.report.trouble).find("environment"), std::string::npos)
      << describe(*mobile(), s.report.trouble);
  s.x[4] = kNan;
  EXPECT_EQ(s.solve(reference), SolveStatus::kNotFinite);
  EXPECT_NE(describe(*mobile(), s.report.trouble).find("SH_FLE"), std::string::npos)
      << describe(*mobile(), s.report.trouble);
  EXPECT_EQ(s.solver.counters().kept, 2u);
}

TEST(SlqSolver, WeightsAreTakenBetweenSolvesAndBadOnesRefused) {
  Session s(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.3, 0.2, 0.0);
  Weights weights = mobile()->weights().configured();
  weights.revision = 5;
  const int index = mobile()->weights().find("end_effector.position_pm2");
  ASSERT_GE(index, 0);
  weights.values[index] *= 2;
  SolveInput input{.t0 = 0, .x0 = s.x.data(), .reference = &reference, .weights = &weights};
  ASSERT_NE(s.solver.solve(input, *s.policy, s.report), SolveStatus::kNotFinite);
  EXPECT_EQ(s.report.weights_revision, 5u);
  const double heavy = s.report.cost_before;
  weights.revision = 6;
  weights.values[index] = kNan;
  ASSERT_NE(s.solver.solve(input, *s.policy, s.report), SolveStatus::kNotFinite);
  EXPECT_EQ(s.report.weights_revision, 5u) << "the last good ones stay in force";
  EXPECT_EQ(s.report.trouble.kind, TroubleKind::kWeights);
  EXPECT_NE(describe(*mobile(), s.report.trouble).find("end_effector.position_pm2"),
            std::string::npos);
  EXPECT_EQ(s.solver.counters().refused_weights, 1u);
  Session plain(mobile());
  ASSERT_NE(plain.solve(reference), SolveStatus::kNotFinite);
  EXPECT_GT(heavy, plain.report.cost_before);
}

TEST(SlqSolver, LimitsAndSafetyAreNoWeights) {
  for (const WeightInfo& info : mobile()->weights().infos()) {
    for (const char* term : {"joint_limits", "velocity_limits", "self_collision", "environment",
                             "stability", "wrench", "velocity_constraint"})
      EXPECT_FALSE(info.name.starts_with(term)) << info.name;
  }
  EXPECT_EQ(mobile()->weights().find("self_collision.mu"), -1);
}

TEST(SlqSolver, WorkStaysWithinItsBoundWhateverTheData) {
  const DistanceField field = field_of({{{0.5, -0.5, 0.0}, {1.6, 0.5, 0.9}}});
  Session s(mobile());
  const WorkBound bound = s.solver.work_bound();
  int least = bound.node_evaluations, most = 0;
  for (int call = 0; call < 40; ++call, s.advance()) {
    const Reference reference =
        reach_ahead(mobile()->model(), call % 8 < 4 ? 2.0 : -1.0, 0.5 * (call % 3), 0.1);
    ASSERT_NE(s.solve(reference, &field), SolveStatus::kNotFinite);
    least = std::min(least, s.report.node_evaluations);
    most = std::max(most, s.report.node_evaluations);
    EXPECT_LE(s.report.term_evaluations, bound.term_evaluations);
    EXPECT_LE(s.report.factorisations, bound.factorisations);
  }
  EXPECT_LE(most, bound.node_evaluations);
  EXPECT_EQ(least, most) << "without a guess every good call visits the same number of nodes";
}

TEST(SlqSolver, ConvergedSolutionHasNothingLeftToMove) {
  Session s(mobile());
  const Reference reference = reach_ahead(mobile()->model(), 0.2, 0.1, 0.05);
  const SolveInput input{.t0 = 0, .x0 = s.x.data(), .reference = &reference};
  EXPECT_LT(s.solver.converge(input, 200, 1e-9, *s.policy, s.report), 200);
  EXPECT_LE(s.report.largest_move, 1e-9);
}

// The value function's gradient against the converged costs of neighbouring starts.
TEST(SlqSolver, ValueFunctionPredictsTheCostOfNeighbours) {
  const auto problem = mobile();
  const Reference reference = reach_ahead(problem->model(), 0.2, 0.1, 0.05);
  const auto cost_from = [&](const StateVector& x, ValueFunction* value) {
    Session s(problem);
    const SolveInput input{.t0 = 0, .x0 = x.data(), .reference = &reference};
    (void)s.solver.converge(input, 300, 1e-10, *s.policy, s.report);
    if (value) *value = s.solver.value_function();
    return s.report.cost_after;
  };
  const StateVector x0 = ready(problem->model());
  ValueFunction value;
  const double here = cost_from(x0, &value);
  EXPECT_NEAR(value.value, here, 1e-9 * (1 + here));
  constexpr double kStep = 1e-4;
  for (int r = 0; r < problem->nx(); ++r) {
    StateVector ahead = x0, behind = x0;
    ahead[r] += kStep;
    behind[r] -= kStep;
    const double slope = (cost_from(ahead, nullptr) - cost_from(behind, nullptr)) / (2 * kStep);
    EXPECT_NEAR(value.gradient[r], slope, 1e-4 * (1 + std::abs(slope)));
  }
}

TEST(SlqSolver, VelocityConstraintIsProjectedOutOfEveryStep) {
  Session s(mobile());
  // The hand is to go ahead and up, but must not leave its height.
  Reference reference = reach_ahead(mobile()->model(), 0.3, 0.1, 0.25);
  reference.ee[0].constraint_count = 1;
  reference.ee[0].constraints[0].row = {0, 0, 1, 0, 0, 0};
  const double height = end_effector_pose(mobile()->model(), s.x).translation().z();
  double moved = 0;
  for (int call = 0; call < 60; ++call, s.advance()) {
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
    if (call >= 5) {
      EXPECT_LE(s.report.equality, 2e-3);  // m/s; second order in the step
    }
    const Eigen::Vector3d p = end_effector_pose(mobile()->model(), s.x).translation();
    EXPECT_NEAR(p.z(), height, 3e-3);
    moved = p.x();
  }
  EXPECT_GT(moved,
            end_effector_pose(mobile()->model(), ready(mobile()->model())).translation().x() + 0.1);
}

TEST(SlqSolver, WantedTwistIsFollowed) {
  Session s(mobile());
  Reference reference;
  reference.ee[0].twist_active = true;
  reference.ee[0].twist_W = {0, 0.1, 0, 0, 0, 0};
  const Eigen::Vector3d start = end_effector_pose(mobile()->model(), s.x).translation();
  for (int call = 0; call < 60; ++call, s.advance())
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
  const Eigen::Vector3d moved = end_effector_pose(mobile()->model(), s.x).translation() - start;
  // 2 s at 0.1 m/s, less what accelerating and the input's weight cost.
  EXPECT_NEAR(moved.y(), 0.2, 0.04);
  EXPECT_LE(moved.head<1>().norm() + std::abs(moved.z()), 0.03);
}

TEST(SlqSolver, AHeavyWrenchIsPreparedForByAStrongerPosture) {
  // The largest static torque as a share of its limit, with 150 N down on the hand.
  const RobotModel& model = mobile()->model();
  const auto load = [&](const StateVector& x) {
    RobotModel::Data data;
    model.forward_kinematics(x.data(), data);
    Jacobian J;
    model.frame_jacobian(model.end_effector(), data, J);
    JointVector gravity(model.joints());
    model.gravity(x.data() + 3, gravity);
    double most = 0;
    for (int j = 0; j < model.joints(); ++j)
      most = std::max(most, std::abs(gravity[j] + 150 * J(2, 3 + j)) / model.limits(j).torque);
    return most;
  };
  Session s(mobile());
  Reference reference;  // free to move: only the wrench asks for anything
  reference.ee[0].wrench_active = true;
  reference.ee[0].wrench_W = {0, 0, -150, 0, 0, 0};
  const double before = load(s.x);
  for (int call = 0; call < 90; ++call, s.advance())
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
  ASSERT_GT(before, 1.0) << "the posture could bear the wrench anyway";
  EXPECT_LE(load(s.x), 1.0);
}

TEST(SlqSolver, ASecondEndEffectorIsLed) {
  RobotConfig config = mabi_config();
  config.more_end_effectors = {"ELBOW"};
  const auto problem =
      std::make_shared<const OptimalControlProblem>(std::make_shared<const RobotModel>(config));
  Session s(problem);
  const RobotModel& model = problem->model();
  StateVector there = s.x;
  there.tail(6) += 0.2 * StateVector::Ones(6);
  RobotModel::Data data;
  model.forward_kinematics(there.data(), data);
  Reference reference;
  for (int k = 0; k < 2; ++k) {
    reference.ee[k].count = 1;
    reference.ee[k].keyframes[0].X_WE = Pose::from(model.X_WF(model.end_effector(k), data));
  }
  for (int call = 0; call < 120; ++call, s.advance())
    ASSERT_NE(s.solve(reference), SolveStatus::kNotFinite);
  model.forward_kinematics(s.x.data(), data);
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector3d p = model.X_WF(model.end_effector(k), data).translation();
    EXPECT_LE((p - reference.ee[k].keyframes[0].X_WE.position()).norm(), 5e-3) << k;
  }
}

}  // namespace
}  // namespace wb::mpc_test
