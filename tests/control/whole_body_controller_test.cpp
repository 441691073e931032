// WholeBodyController: set-points, gravity torque, wheel kinematics, and which way the admittance
// gives way.
#include "control/whole_body_controller.hpp"

#include <gtest/gtest.h>

#include <Eigen/SVD>

#include "core/rt/allocation_count.hpp"
#include "tests/control/robot.hpp"

namespace wb {
namespace {

using control_test::kDt;
using control_test::mabi;

constexpr double kTranslationMax = 0.05;     // m/s, control.yaml
constexpr double kTranslationDamping = 800;  // Ns/m
constexpr double kRotationMax = 0.2;         // rad/s
constexpr double kLeastSingular = 0.05;

Policy constant_policy(const JointVector& dq, double v, double w) {
  Policy p;
  p.nodes = 2;
  p.states = mabi()->nx();
  p.inputs = mabi()->nu();
  p.t[1] = kNanosPerSecond;
  p.u(0) << v, w, dq;
  return p;
}

struct Rig {
  WholeBodyController controller{mabi(), control_test::control_section("whole_body")};
  RobotState state = control_test::standing_state(mabi()->config().ready);
  WholeBodyInput in;
  Command out;

  Rig() {
    in.state = &state;
    in.dt_s = kDt;
    in.gripper = {0.02, 30};
  }
  void step() { controller.step(in, out); }
  JointVector rates() const {
    JointVector dq(mabi()->joints());
    for (int i = 0; i < dq.size(); ++i) dq[i] = out.joints[i].velocity;
    return dq;
  }
  Eigen::Matrix<double, 6, Eigen::Dynamic> arm_jacobian() const {
    RobotModel::Data data;
    mabi()->forward_kinematics(control_test::state_vector(state.base, state.q.data()).data(), data);
    Jacobian J;
    mabi()->frame_jacobian(mabi()->end_effector(), data, J);
    return J.rightCols(mabi()->joints());
  }
  // The environment pushes the hand with this force and torque, given in W.
  void push(const Eigen::Vector3d& force_W, const Eigen::Vector3d& torque_W = {0, 0, 0}) {
    const Eigen::Matrix3d R_WE = control_test::hand_pose(state.base, state.q.data()).linear();
    Eigen::Vector3d::Map(state.wrench.data()) = R_WE.transpose() * force_W;
    Eigen::Vector3d::Map(state.wrench.data() + 3) = R_WE.transpose() * torque_W;
  }
  // The damped pseudo-inverse gives at least this part of a wanted twist.
  double least_gain() const {
    const double s = Eigen::JacobiSVD<Eigen::MatrixXd>(arm_jacobian()).singularValues().minCoeff();
    return s * s / (s * s + kLeastSingular * kLeastSingular);
  }
};

TEST(WholeBodyController, SetPointsAdvanceByThePolicysVelocity) {
  Rig rig;
  JointVector dq(6);
  dq << 0.1, -0.2, 0.3, -0.4, 0.5, -0.6;
  const Policy policy = constant_policy(dq, 0, 0);
  rig.in.policy = &policy;
  rig.state.q[2] +=
      0.05;  // the measured posture lags behind; set-points go on from where they stand
  rig.step();
  EXPECT_EQ(rig.out.joint_count, 6);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(rig.out.joints[i].kind, CommandKind::kImpedance);
    EXPECT_NEAR(rig.out.joints[i].position, rig.state.q_command[i] + dq[i] * kDt, 1e-15);
    EXPECT_EQ(rig.out.joints[i].velocity, dq[i]);
  }
  EXPECT_EQ(rig.out.gripper.opening_m, 0.02);
  EXPECT_EQ(rig.out.gripper.force_n, 30.0);
}

TEST(WholeBodyController, FeedbackActsOnSetPointsAndOnTheMeasuredBase) {
  Rig rig;
  Policy policy = constant_policy(JointVector::Zero(6), 0, 0);
  for (int node = 0; node < 2; ++node) {
    policy.x(node) << 0, 0, 0, Eigen::VectorXd::Map(rig.state.q_command.data(), 6);
  }
  policy.K(0)(0, 0) = -2.0;  // v on x
  policy.K(0)(2, 3) = -3.0;  // dq0 on q0
  rig.state.base[0] = 0.1;
  rig.state.q[0] += 1.0;  // measured: does not count
  rig.state.q_command[0] += 0.01;
  rig.in.policy = &policy;
  rig.step();
  EXPECT_NEAR(rig.out.joints[0].velocity, -0.03, 1e-12);
  const double radius = mabi()->config().base.wheel_radius_m;
  EXPECT_NEAR(rig.out.wheels[0].velocity * radius, -0.2, 1e-12);
}

TEST(WholeBodyController, TorqueCarriesTheArmsWeightInTheMeasuredPosture) {
  Rig rig;
  rig.state.q[1] += 0.3;
  JointVector gravity;
  mabi()->gravity(rig.state.q.data(), gravity);
  rig.step();
  for (int i = 0; i < 6; ++i) EXPECT_EQ(rig.out.joints[i].torque, gravity[i]);
  EXPECT_GT(gravity.norm(), 10.0) << "or the test says nothing";
}

TEST(WholeBodyController, WheelsGiveTheAskedForwardSpeedAndYawRate) {
  Rig rig;
  const Policy policy = constant_policy(JointVector::Zero(6), 0.4, 0.3);
  rig.in.policy = &policy;
  rig.step();
  const BaseConfig& b = mabi()->config().base;
  const double left = rig.out.wheels[0].velocity, right = rig.out.wheels[1].velocity;
  EXPECT_EQ(rig.out.wheel_count, 2);
  EXPECT_NEAR(0.5 * b.wheel_radius_m * (left + right), 0.4, 1e-12);
  EXPECT_NEAR(b.wheel_radius_m * (right - left) / b.track_m, 0.3, 1e-12)
      << "left turn: right is faster";
}

TEST(WholeBodyController, StandsStillWithoutAUsablePolicy) {
  JointVector dq = JointVector::Constant(6, 0.5);
  Policy ended = constant_policy(dq, 0.5, 0.5), other_robot = ended;
  other_robot.states = 7;
  for (const Policy* policy :
       {static_cast<const Policy*>(nullptr), &std::as_const(ended), &std::as_const(other_robot)}) {
    Rig rig;
    rig.state.t_ns = kNanosPerSecond;  // the end of the policy's horizon
    rig.in.policy = policy;
    rig.step();
    for (int i = 0; i < 6; ++i) {
      EXPECT_EQ(rig.out.joints[i].position, rig.state.q_command[i]);
      EXPECT_EQ(rig.out.joints[i].velocity, 0.0);
    }
    EXPECT_EQ(rig.out.wheels[0].velocity, 0.0);
    EXPECT_EQ(rig.out.wheels[1].velocity, 0.0);
  }
}

TEST(WholeBodyController, HandGivesWayToAPushAcrossThePath) {
  for (const Eigen::Vector3d& across :
       {Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0, -1, 0), Eigen::Vector3d(0, 0, 1)}) {
    Rig rig;
    rig.state.base = {1.0, -2.0, 0.7};
    rig.in.held = true;
    rig.in.free_direction_W = -Eigen::Vector3d::UnitX();
    rig.push(20.0 * across);
    rig.step();
    const Eigen::Vector3d v_W = rig.arm_jacobian().topRows<3>() * rig.rates();
    const double wanted = 20.0 / kTranslationDamping;
    EXPECT_GE(across.dot(v_W), rig.least_gain() * wanted);
    EXPECT_LE(v_W.norm(), wanted * (1 + 1e-12));
    for (int i = 0; i < 6; ++i) {
      EXPECT_NEAR(rig.out.joints[i].position, rig.state.q_command[i] + rig.rates()[i] * kDt, 1e-15);
    }
  }
}

TEST(WholeBodyController, HandDoesNotGiveWayAlongThePath) {
  Rig rig;
  rig.in.held = true;
  rig.in.free_direction_W = Eigen::Vector3d(-1, 0.5, 0).normalized();
  rig.push(-100.0 * rig.in.free_direction_W);
  rig.step();
  EXPECT_LE(rig.rates().norm(), 1e-12);
}

TEST(WholeBodyController, HandTurnsWithATorque) {
  Rig rig;
  rig.in.held = true;
  rig.in.free_direction_W = -Eigen::Vector3d::UnitX();
  rig.push({0, 0, 0}, {0, 0, 2.0});
  rig.step();
  const Eigen::Vector3d w_W = rig.arm_jacobian().bottomRows<3>() * rig.rates();
  EXPECT_GE(w_W.z(), rig.least_gain() * 2.0 / 40.0);
}

TEST(WholeBodyController, AdmittanceSpeedIsLimited) {
  Rig rig;
  rig.in.held = true;
  rig.in.free_direction_W = -Eigen::Vector3d::UnitX();
  rig.push({0, 1e4, 1e4}, {1e3, 0, 0});
  rig.step();
  const Eigen::VectorXd twist = rig.arm_jacobian() * rig.rates();
  // The damped inverse shrinks the twist as a whole, never a component beyond the whole.
  EXPECT_LE(twist.norm(), std::hypot(kTranslationMax, kRotationMax));
}

TEST(WholeBodyController, AdmittanceIsOffWhenNothingIsHeld) {
  Rig rig;
  rig.push({100, 100, 100}, {10, 10, 10});
  rig.step();
  EXPECT_EQ(rig.rates().norm(), 0.0);
}

TEST(WholeBodyController, StepDoesNotAllocate) {
  Rig rig;
  const Policy policy = constant_policy(JointVector::Constant(6, 0.1), 0.1, 0.1);
  rig.in.policy = &policy;
  rig.in.held = true;
  rig.push({10, 10, 10});
  const std::uint64_t before = thread_allocations();
  for (int i = 0; i < 10; ++i) rig.step();
  EXPECT_EQ(thread_allocations(), before);
}

}  // namespace
}  // namespace wb
