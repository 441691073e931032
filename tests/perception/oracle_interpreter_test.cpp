// OracleInterpreter and Perceiver: the errors that DEFINITIONS.md asks for, and when a handle
// counts as measured.
#include "perception/oracle_interpreter.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "perception/perceiver.hpp"

namespace wb {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

std::shared_ptr<const RobotModel> mabi() {
  static const auto model = std::make_shared<const RobotModel>(
      RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile"));
  return model;
}

Isometry3d camera_in_base(const std::array<double, kMaxJoints>& q) {
  StateVector x = StateVector::Zero(mabi()->nx());
  for (int i = 0; i < mabi()->joints(); ++i) x[3 + i] = q[i];
  RobotModel::Data data;
  mabi()->forward_kinematics(x.data(), data);
  return mabi()->X_WF(mabi()->frame(mabi()->config().shoulder_camera), data);
}

// A robot before a drawer in the simulated world S. The base truly stands at X_SB; its odometry
// says `state.base`.
struct Scene {
  Isometry3d X_SW = planar_isometry(5.0, -2.0, 0.7);  // where the base started
  Isometry3d X_SB = X_SW * planar_isometry(1.0, 0.4, 0.3);
  RobotState state;
  double handle_ahead_m = 0.5;  // of the camera, along its optical axis
  OracleOptions options;

  Scene() {
    state.base = {1.0, 0.4, 0.3};
    std::copy(mabi()->config().ready.begin(), mabi()->config().ready.end(), state.q.begin());
    state.phase = Phase::kPreGrasp;
  }
  ObjectTruth truth() const {
    ObjectTruth t;
    t.X_SC = X_SB * camera_in_base(state.q);
    t.X_SG = t.X_SC * Eigen::Translation3d(0, 0, handle_ahead_m);
    t.articulation.kind = JointKind::kPrismatic;
    Vector3d::Map(t.articulation.axis.data()) = -t.X_SG.linear().col(2);
    Vector3d::Map(t.articulation.axis_origin.data()) = t.X_SG.translation();
    t.articulation.range = 0.4;
    t.articulation.value = 0.05;
    t.handle_radius_m = 0.008;
    t.handle_length_m = 0.2;
    for (MaskBox& m : t.masks) m.X_WM = Pose::from(t.X_SG);
    return t;
  }
  std::unique_ptr<OracleInterpreter> interpreter() const {
    return std::make_unique<OracleInterpreter>(
        mabi(), options,
        [t = truth()](const Name& name, ObjectTruth& out) {
          out = t;
          return name == Name("drawer_1");
        },
        X_SW);
  }
  ObjectPlan interpret() const {
    ObjectPlan plan;
    EXPECT_TRUE(interpreter()->interpret(Name("drawer_1"), state, plan));
    return plan;
  }
};

double yaw_between(const Pose& a, const Pose& b) {
  const Eigen::AngleAxisd turn(
      Eigen::Matrix3d(b.isometry().linear() * a.isometry().linear().transpose()));
  return turn.angle() * turn.axis().z();
}

void no_error(OracleOptions& o) { o.prior_m = o.prior_rad = o.measured_m = o.measured_rad = 0; }

TEST(OracleInterpreter, MeasuresInThePreGraspWithTheHandleInViewOnly) {
  Scene s;
  EXPECT_TRUE(s.interpret().measured);
  for (const Phase p : {Phase::kNone, Phase::kApproach, Phase::kGrasp, Phase::kManipulate,
                        Phase::kRelease, Phase::kRetreat}) {
    s.state.phase = p;
    EXPECT_FALSE(s.interpret().measured) << to_string(p);
  }
  s.state.phase = Phase::kPreGrasp;
  s.handle_ahead_m = -0.5;
  EXPECT_FALSE(s.interpret().measured) << "behind the camera";
  s.handle_ahead_m = 0.05;
  EXPECT_FALSE(s.interpret().measured) << "nearer than the camera sees";
  s.handle_ahead_m = 9.0;
  EXPECT_FALSE(s.interpret().measured) << "farther than the camera sees";
}

TEST(OracleInterpreter, HandleBesideThePictureIsNotInView) {
  // 87 degrees wide, 71 high: at 1 m ahead, 0.95 m to the right and 0.71 m down are the edges.
  for (const auto& [offset, seen] : {std::pair{Vector3d(0.94, 0, 1), true},
                                     {Vector3d(0.96, 0, 1), false},
                                     {Vector3d(0, 0.70, 1), true},
                                     {Vector3d(0, 0.72, 1), false}}) {
    Scene s;
    ObjectTruth t = s.truth();
    t.X_SG = t.X_SC * Eigen::Translation3d(offset);
    OracleInterpreter oracle(
        mabi(), s.options,
        [&](const Name&, ObjectTruth& out) {
          out = t;
          return true;
        },
        s.X_SW);
    ObjectPlan plan;
    ASSERT_TRUE(oracle.interpret(Name("x"), s.state, plan));
    EXPECT_EQ(plan.measured, seen) << offset.transpose();
  }
}

TEST(OracleInterpreter, WithoutErrorEverythingIsWhereItIs) {
  for (const Phase phase : {Phase::kApproach, Phase::kPreGrasp}) {
    Scene s;
    s.state.phase = phase;
    no_error(s.options);
    const ObjectPlan plan = s.interpret();
    const ObjectTruth t = s.truth();
    const Isometry3d X_WS = s.X_SW.inverse();
    EXPECT_TRUE(plan.X_WG.isometry().isApprox(X_WS * t.X_SG, 1e-9));
    const Vector3d axis = X_WS.linear() * Vector3d::Map(t.articulation.axis.data());
    const Vector3d origin = X_WS * Vector3d(Vector3d::Map(t.articulation.axis_origin.data()));
    EXPECT_LE((Vector3d::Map(plan.articulation.axis.data()) - axis).norm(), 1e-9);
    EXPECT_LE((Vector3d::Map(plan.articulation.axis_origin.data()) - origin).norm(), 1e-9);
    EXPECT_EQ(plan.articulation.value, 0.05);
    EXPECT_EQ(plan.articulation.range, 0.4);
    EXPECT_EQ(plan.handle_radius_m, 0.008);
    for (const MaskBox& m : plan.masks) {
      EXPECT_TRUE(m.active);
      EXPECT_TRUE(m.X_WM.isometry().isApprox(X_WS * t.X_SG, 1e-9));
    }
  }
}

TEST(OracleInterpreter, OdometryDriftCancelsInTheMeasurementAndNotInThePrior) {
  Scene s;
  no_error(s.options);
  s.state.base = {1.3, 0.2, 0.5};  // the odometry is wrong by 0.36 m and 0.2 rad
  const Isometry3d X_BG = s.X_SB.inverse() * s.truth().X_SG;
  const ObjectPlan measured = s.interpret();
  ASSERT_TRUE(measured.measured);
  EXPECT_TRUE((s.state.X_WB().inverse() * measured.X_WG.isometry()).isApprox(X_BG, 1e-9))
      << "where the hand finds it";
  s.state.phase = Phase::kApproach;
  EXPECT_GT(((s.state.X_WB().inverse() * s.interpret().X_WG.isometry()).translation() -
             X_BG.translation())
                .norm(),
            0.2);
}

TEST(OracleInterpreter, ErrorsHaveTheStatedSpread) {
  constexpr int kSeeds = 2000;
  for (const Phase phase : {Phase::kApproach, Phase::kPreGrasp}) {
    Scene s;
    s.state.phase = phase;
    const Pose exact = Pose::from(Isometry3d(s.X_SW.inverse() * s.truth().X_SG));
    const bool measured = phase == Phase::kPreGrasp;
    const double sigma[4] = {measured ? s.options.measured_m : s.options.prior_m, 0, 0,
                             measured ? s.options.measured_rad : s.options.prior_rad};
    double sum[4] = {}, square[4] = {}, across = 0;
    for (int seed = 0; seed < kSeeds; ++seed) {
      s.options.seed = seed;
      const ObjectPlan plan = s.interpret();
      const Vector3d d = plan.X_WG.position() - exact.position();
      const double e[4] = {d.x(), d.y(), d.z(), yaw_between(exact, plan.X_WG)};
      for (int i = 0; i < 4; ++i) {
        sum[i] += e[i];
        square[i] += e[i] * e[i];
      }
      across += e[0] * e[1];
      // The unit is rigid: its axis turns with it and is level as before.
      EXPECT_NEAR(
          Vector3d::Map(plan.articulation.axis.data()).dot(plan.X_WG.isometry().linear().col(2)),
          -1.0, 1e-9);
    }
    for (int i = 0; i < 4; ++i) {
      const double one = i == 3 ? sigma[3] : sigma[0];
      // Standard errors of a mean, s / sqrt(n), and of a standard deviation, s / sqrt(2 n); four of
      // them.
      EXPECT_LE(std::abs(sum[i] / kSeeds), 4 * one / std::sqrt(kSeeds)) << "axis " << i;
      EXPECT_NEAR(std::sqrt(square[i] / kSeeds), one, 4 * one / std::sqrt(2.0 * kSeeds))
          << "axis " << i;
    }
    EXPECT_LE(std::abs(across / kSeeds), 4 * sigma[0] * sigma[0] / std::sqrt(kSeeds))
        << "axes are independent";
  }
}

TEST(OracleInterpreter, SameSeedGivesTheSameErrorAndItStaysForTheRun) {
  Scene s;
  s.options.seed = 42;
  const Pose a = s.interpret().X_WG, b = s.interpret().X_WG;
  EXPECT_EQ(a.p, b.p);
  EXPECT_EQ(a.q, b.q);
  const auto oracle = s.interpreter();
  ObjectPlan first, later;
  ASSERT_TRUE(oracle->interpret(Name("drawer_1"), s.state, first));
  s.state.t_ns += kNanosPerSecond;
  ASSERT_TRUE(oracle->interpret(Name("drawer_1"), s.state, later));
  EXPECT_EQ(first.X_WG.p, later.X_WG.p) << "drawn once per run, not per look";
  s.options.seed = 43;
  EXPECT_NE(s.interpret().X_WG.p, a.p);
}

TEST(OracleInterpreter, UnknownObjectIsNotFound) {
  Scene s;
  ObjectPlan plan;
  EXPECT_FALSE(s.interpreter()->interpret(Name("drawer_9"), s.state, plan));
}

TEST(Perceiver, NothingAskedForGivesNothing) {
  Scene s;
  Perceiver perceiver(mabi(), s.interpreter());
  ObjectPlan plan;
  EXPECT_FALSE(perceiver.step(s.state, plan));
}

TEST(Perceiver, ObjectThatIsNotThereGivesNothing) {
  Scene s;
  Perceiver perceiver(mabi(), s.interpreter());
  perceiver.look_for(Name("drawer_9"));
  ObjectPlan plan;
  EXPECT_FALSE(perceiver.step(s.state, plan));
}

TEST(Perceiver, PlanNamesItsObjectAndTimeAndHasKeyframes) {
  Scene s;
  s.state.t_ns = 123;
  Perceiver perceiver(mabi(), s.interpreter());
  perceiver.look_for(Name("drawer_1"));
  ObjectPlan plan;
  ASSERT_TRUE(perceiver.step(s.state, plan));
  EXPECT_EQ(plan.object.view(), "drawer_1");
  EXPECT_EQ(plan.t_ns, 123);
  ASSERT_GT(plan.keyframe_count, 1);
  EXPECT_EQ(plan.keyframe_value[0], 0.05);
  EXPECT_LE((plan.keyframes[0].position() - plan.X_WG.position()).norm(), 1e-12);
}

TEST(Perceiver, HandIsRolledAsInTheReadyPosture) {
  // Whichever way round the handle's x axis is given, a hand in the ready posture need not turn
  // over.
  for (const double roll : {0.0, M_PI}) {
    Scene s;
    ObjectTruth t = s.truth();
    StateVector x = StateVector::Zero(mabi()->nx());
    for (int i = 0; i < 6; ++i) x[3 + i] = mabi()->config().ready[i];
    RobotModel::Data data;
    mabi()->forward_kinematics(x.data(), data);
    const Isometry3d X_SE = s.X_SB * mabi()->X_WF(mabi()->end_effector(), data);
    t.X_SG = X_SE * Eigen::AngleAxisd(roll, Vector3d::UnitZ());
    no_error(s.options);
    Perceiver perceiver(mabi(), std::make_unique<OracleInterpreter>(
                                    mabi(), s.options,
                                    [&](const Name&, ObjectTruth& out) {
                                      out = t;
                                      return true;
                                    },
                                    s.X_SW));
    perceiver.look_for(Name("drawer_1"));
    ObjectPlan plan;
    ASSERT_TRUE(perceiver.step(s.state, plan));
    EXPECT_TRUE(plan.keyframes[0].isometry().isApprox(s.X_SW.inverse() * X_SE, 1e-9)) << roll;
  }
}

}  // namespace
}  // namespace wb
