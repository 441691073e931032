// Estimator, gate and controller on every robot of config/robots: what they promise whatever the
// base and the joints are.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "control/controller.hpp"
#include "tests/control/robot.hpp"
#include "tests/core/model/robots.hpp"

namespace wb {
namespace {

using control_test::kDt;
using control_test::kPeriodNs;

class EveryRobot : public ::testing::TestWithParam<std::string> {
 protected:
  const std::shared_ptr<const RobotModel> model =
      std::make_shared<const RobotModel>(test::robot(GetParam()));
  const RobotConfig& config = model->config();
  const WheelKinematics kinematics{config.base};

  // Still, in the ready posture.
  Readings readings() const {
    Readings r;
    r.t_ns = kNanosPerSecond;
    r.joint_count = model->joints();
    r.wheel_count = kinematics.wheels();
    for (int i = 0; i < r.joint_count; ++i) r.joints[i] = {config.ready[i], 0, 0, 0, true};
    for (int i = 0; i < r.wheel_count; ++i) r.wheels[i] = {1.0 * i, 0, 0, 0, true};
    return r;
  }
};
INSTANTIATE_TEST_SUITE_P(Robots, EveryRobot, ::testing::ValuesIn(test::robot_names()),
                         [](const auto& info) { return info.param; });

TEST_P(EveryRobot, OdometryFollowsTheArcOfAConstantTwist) {
  Estimator estimator(model,
                      config::Section::open(config.folder / "control.yaml").section("estimator"));
  RobotState state;
  Readings r = readings();
  estimator.step(r, state);
  const bool sideways = config.base.kind == BaseKind::kOmnidirectional;
  const WheelKinematics::Twist v = {0.4, sideways ? -0.3 : 0.0, 0.5};
  const WheelKinematics::Wheels speed = kinematics.wheel_speeds(v);
  constexpr int kSteps = 800;
  for (int k = 0; k < kSteps; ++k) {
    r.t_ns += kPeriodNs;
    for (int i = 0; i < r.wheel_count; ++i) {
      r.wheels[i].position += speed[i] * kDt;
      r.wheels[i].velocity = speed[i];
    }
    estimator.step(r, state);
  }
  const bool drives = config.base.kind != BaseKind::kFixed;
  const double t = kSteps * kDt, yaw = v[2] * t;
  // Integral of R(w s) v over s.
  const double x = (v[0] * std::sin(yaw) - v[1] * (1 - std::cos(yaw))) / v[2];
  const double y = (v[0] * (1 - std::cos(yaw)) + v[1] * std::sin(yaw)) / v[2];
  constexpr double kMidpoint = 1e-6;  // speed * t * (w dt)^2 / 24
  EXPECT_NEAR(state.base[0], drives ? x : 0.0, kMidpoint);
  EXPECT_NEAR(state.base[1], drives ? y : 0.0, kMidpoint);
  EXPECT_NEAR(state.base[2], drives ? yaw : 0.0, 1e-9);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(state.base_velocity[i], drives ? v[i] : 0.0, 1e-12) << i;
}

// The gate's promise, whatever it is asked: positions continuous and within their ranges, rates
// and their changes within their limits, and the same for the base.
TEST_P(EveryRobot, GateKeepsEveryLimitOfEveryJointAndOfTheBase) {
  CommandGate gate(model);
  gate.reset(config.ready.data());
  std::mt19937 random(1);
  std::array<double, kMaxJoints> position{}, velocity{};
  std::copy(config.ready.begin(), config.ready.end(), position.begin());
  WheelKinematics::Twist base{};
  Command request;
  request.joint_count = model->joints();
  request.wheel_count = kinematics.wheels();
  constexpr double kRounding = 1e-9;
  bool turned_round = false;
  // Last, the continuous joints alone go on and on: one factor slows all joints, so beside a slow
  // slide that is asked for ten metres they do not get far.
  constexpr int kAnything = 8000, kTurning = 4000;
  for (int k = 0; k < kAnything + kTurning; ++k) {
    request.t_ns = (k + 1) * kPeriodNs;
    if (k >= kAnything) {
      for (int i = 0; i < request.joint_count; ++i) {
        if (model->limits(i).endless() || k == kAnything)
          request.joints[i].position = position[i] + (model->limits(i).endless() ? 1 : 0);
      }
    } else if (k % 400 == 0) {
      std::uniform_real_distribution<double> any(-1, 1);
      for (int i = 0; i < request.joint_count; ++i)
        request.joints[i].position = position[i] + 10 * any(random);
      for (int i = 0; i < request.wheel_count; ++i) request.wheels[i].velocity = 40 * any(random);
    }
    const SafeCommand out = gate.step(request, request.t_ns, kDt, Mode::kActive);
    const Command& c = out.get();
    ASSERT_EQ(c.wheel_count, kinematics.wheels());
    for (int i = 0; i < model->joints(); ++i) {
      const JointLimits& l = model->limits(i);
      ASSERT_GE(c.joints[i].position, l.lower - kRounding);
      ASSERT_LE(c.joints[i].position, l.upper + kRounding);
      ASSERT_LE(std::abs(c.joints[i].position - position[i]), l.velocity * kDt + kRounding);
      ASSERT_LE(std::abs(c.joints[i].velocity - velocity[i]), l.acceleration * kDt + kRounding)
          << config.joints[i].name;
      turned_round = turned_round || std::abs(c.joints[i].position) > 2 * M_PI;
      position[i] = c.joints[i].position;
      velocity[i] = c.joints[i].velocity;
    }
    WheelKinematics::Wheels speeds{};
    for (int i = 0; i < c.wheel_count; ++i) speeds[i] = c.wheels[i].velocity;
    const WheelKinematics::Twist v = kinematics.twist(speeds);
    for (int i = 0; i < 3; ++i) {
      const double fastest = i == 2 ? config.base.yaw_rate_max : config.base.velocity_max;
      const double hardest =
          i == 2 ? config.base.yaw_acceleration_max : config.base.acceleration_max;
      ASSERT_LE(std::abs(v[i]), fastest + kRounding);
      ASSERT_LE(std::abs(v[i] - base[i]), hardest * kDt + kRounding);
    }
    base = v;
  }
  bool endless = false;
  for (int i = 0; i < model->joints(); ++i) endless = endless || model->limits(i).endless();
  EXPECT_TRUE(turned_round || !endless) << "nothing stops a continuous joint";
}

struct Tick {
  RobotState state;
  Reference reference;
  ControlOutput out;
  Tick() {
    out.state = &state;
    out.reference = &reference;
  }
};

RequestStatus ask(Controller& controller, Tick& tick, Readings& r, Request request) {
  r.t_ns += kPeriodNs;
  request.t_ns = r.t_ns;
  controller.step({r.t_ns, &r, nullptr, nullptr, &request, 1}, tick.out);
  return tick.out.status_count > 0 ? tick.out.statuses[0] : RequestStatus{};
}

TEST_P(EveryRobot, ControllerGetsReadyAndMovesABaseOnlyIfThereIsOne) {
  Controller controller(model);
  Tick tick;
  Readings r = readings();
  Request request;
  request.id = 1;
  request.kind = RequestKind::kReset;
  EXPECT_EQ(ask(controller, tick, r, request).outcome, RequestOutcome::kSucceeded);
  EXPECT_EQ(tick.state.mode, Mode::kReady);
  request.id = 2;
  request.kind = RequestKind::kMoveBase;
  request.base = {1, 0, 0};
  const RequestStatus status = ask(controller, tick, r, request);
  if (config.base.kind == BaseKind::kFixed) {
    EXPECT_EQ(status.outcome, RequestOutcome::kRefused);
    EXPECT_EQ(status.reason.view(), "the base is fixed");
  } else {
    EXPECT_EQ(status.outcome, RequestOutcome::kAccepted);
    EXPECT_TRUE(tick.reference.base_goal_active);
  }
}

// Where a continuous joint stands after some turns, its postures are the nearest ones.
TEST_P(EveryRobot, PosturesAreTheNearestTurnOfAContinuousJoint) {
  Controller controller(model);
  Tick tick;
  Readings r = readings();
  for (int i = 0; i < model->joints(); ++i) {
    if (model->limits(i).endless()) r.joints[i].position += 6 * M_PI;
  }
  Request request;
  request.id = 1;
  request.kind = RequestKind::kReset;
  ask(controller, tick, r, request);
  request.id = 2;
  request.kind = RequestKind::kMoveJoints;
  request.joint_count = model->joints();
  std::copy(config.stowed.begin(), config.stowed.end(), request.q.begin());
  EXPECT_EQ(ask(controller, tick, r, request).outcome, RequestOutcome::kAccepted);
  for (int i = 0; i < model->joints(); ++i) {
    const double wanted = tick.reference.posture[i];
    if (!model->limits(i).endless()) {
      EXPECT_EQ(wanted, config.stowed[i]);
      continue;
    }
    EXPECT_LE(std::abs(wanted - r.joints[i].position), M_PI + 1e-9);
    EXPECT_NEAR(std::remainder(wanted - config.stowed[i], 2 * M_PI), 0, 1e-9);
  }
}

// A fixed robot cannot come nearer: what its arm is too short for ends at once, with the reason.
TEST(FixedRobot, GivesUpAnObjectOutOfReachAndTakesOneWithin) {
  const auto model = std::make_shared<const RobotModel>(test::robot("panda"));
  const config::Section section =
      config::Section::open(model->config().folder / "control.yaml").section("sequencer");
  RobotState state;
  state.joint_count = model->joints();
  std::copy(model->config().ready.begin(), model->config().ready.end(), state.q.begin());
  state.q_command = state.q;
  for (const double distance_m : {0.75, 2.5}) {
    TaskSequencer sequencer(model, section);
    Request request;
    request.kind = RequestKind::kOpen;
    request.object = Name("drawer");
    sequencer.start(request, state);
    ObjectPlan plan;
    plan.object = request.object;
    plan.measured = true;
    plan.articulation.kind = JointKind::kPrismatic;
    plan.articulation.axis = {-1, 0, 0};
    plan.articulation.range = 0.3;
    plan.keyframe_count = 2;
    Eigen::Matrix3d R_WE;  // z forward
    R_WE << 0, 0, 1, 1, 0, 0, 0, 1, 0;
    plan.keyframes[0] = Pose::from({distance_m, 0, 0.7}, Eigen::Quaterniond(R_WE));
    plan.keyframes[1] = Pose::from({distance_m - 0.3, 0, 0.7}, Eigen::Quaterniond(R_WE));
    plan.keyframe_value[1] = 0.3;
    Reference reference;
    const TaskOutput out = sequencer.step({kPeriodNs, kDt, &state, &plan}, reference);
    if (distance_m < 1) {
      EXPECT_EQ(out.phase, Phase::kPreGrasp);
      EXPECT_FALSE(reference.base_goal_active);
    } else {
      EXPECT_EQ(out.phase, Phase::kFailed);
      EXPECT_TRUE(out.ended);
      EXPECT_EQ(out.failure, "out of reach");
    }
  }
}

}  // namespace
}  // namespace wb
