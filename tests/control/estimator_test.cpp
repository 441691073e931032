// Estimator against closed forms: synthetic wheel, gyro and wrench readings of known motions.
#include "control/estimator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/rt/allocation_count.hpp"
#include "tests/control/robot.hpp"

namespace wb {
namespace {

using control_test::kDt;
using control_test::kPeriodNs;
using control_test::mabi;

// A base that drives with v and w; its wheels and gyro, as exact as doubles are.
struct Drive {
  Estimator estimator{mabi(), control_test::control_section("estimator")};
  RobotState state;
  Readings r;
  double left = 12.3, right = -4.5;  // encoders start anywhere

  Drive() {
    r.t_ns = 5 * kNanosPerSecond;
    r.joint_count = mabi()->joints();
    r.wheel_count = 2;
    for (int i = 0; i < r.joint_count; ++i) {
      r.joints[i] = {mabi()->config().ready[i], 0.1 * i, 2.0 * i, 0, true};
    }
    r.imu_valid = r.wrench_valid = r.gripper_valid = true;
    read();
  }
  void read() {
    r.wheels[0].position = left;
    r.wheels[1].position = right;
    r.wheels[0].valid = r.wheels[1].valid = true;
    estimator.step(r, state);
  }
  void move(double v, double w, double seconds, double gyro_bias = 0) {
    const BaseConfig& b = mabi()->config().base;
    const double wl = (v - 0.5 * b.track_m * w) / b.wheel_radius_m;
    const double wr = (v + 0.5 * b.track_m * w) / b.wheel_radius_m;
    const int steps = static_cast<int>(std::lround(seconds / kDt));
    for (int i = 0; i < steps; ++i) {
      left += wl * kDt;
      right += wr * kDt;
      r.t_ns += kPeriodNs;
      r.wheels[0].velocity = wl;
      r.wheels[1].velocity = wr;
      r.gyro = {0, 0, w + gyro_bias};
      read();
    }
  }
};

// Sums of a few thousand steps of about 1e-3: rounding stays far below a nanometre.
constexpr double kRounding = 1e-9;

TEST(Estimator, OdometryStartsAtZeroWhereverTheEncodersStand) {
  const Drive d;
  EXPECT_EQ(d.state.base, (std::array<double, 3>{0, 0, 0}));
}

TEST(Estimator, StraightLineIsExact) {
  Drive d;
  d.move(0.7, 0, 4.0);
  EXPECT_NEAR(d.state.base[0], 2.8, kRounding);
  EXPECT_NEAR(d.state.base[1], 0, kRounding);
  EXPECT_NEAR(d.state.base[2], 0, kRounding);
  EXPECT_NEAR(d.state.base_velocity[0], 0.7, kRounding);
  d.move(-0.7, 0, 4.0);
  EXPECT_NEAR(d.state.base[0], 0, kRounding);
}

TEST(Estimator, ArcMatchesTheClosedForm) {
  for (const double w : {0.8, -0.8}) {
    Drive d;
    const double v = 0.5, seconds = 5.0;
    d.move(v, w, seconds);
    // The midpoint rule takes the chord for as long as the arc: relative error (w dt)^2 / 24.
    const double midpoint_error = v * seconds * w * w * kDt * kDt / 24;
    EXPECT_NEAR(d.state.base[0], v / w * std::sin(w * seconds), midpoint_error + kRounding);
    EXPECT_NEAR(d.state.base[1], v / w * (1 - std::cos(w * seconds)), midpoint_error + kRounding);
    EXPECT_NEAR(d.state.base[2], w * seconds, kRounding) << "continuous, not wrapped";
    EXPECT_NEAR(d.state.base_velocity[0], v, kRounding);
    EXPECT_NEAR(d.state.base_velocity[2], w, kRounding);
  }
}

TEST(Estimator, ForwardIsAlongTheBasesOwnXAxis) {
  Drive d;
  d.move(0, 1.0, M_PI / 2);  // turn left on the spot (to the nearest step)
  const double yaw = d.state.base[2];
  EXPECT_NEAR(d.state.base[0], 0, kRounding);
  d.move(1.0, 0, 1.0);
  EXPECT_NEAR(d.state.base[0], std::cos(yaw), kRounding);
  EXPECT_NEAR(d.state.base[1], std::sin(yaw), kRounding);
  EXPECT_NEAR(yaw, M_PI / 2, kDt);
}

TEST(Estimator, GyroOverrulesSlippingWheels) {
  Drive d;
  const double w = 0.4;
  for (int i = 0; i < 400; ++i) {
    d.left += 0.01;  // the wheels say: straight on
    d.right += 0.01;
    d.r.t_ns += kPeriodNs;
    d.r.wheels[0].velocity = d.r.wheels[1].velocity = 4.0;
    d.r.gyro = {0, 0, w};
    d.read();
  }
  EXPECT_NEAR(d.state.base[2], w * 1.0, kRounding);
}

TEST(Estimator, GyroBiasIsLearntStandingStillAndRemoved) {
  constexpr double kBias = 0.02;  // rad/s
  Drive d;
  d.move(0, 0, 20.0, kBias);
  const double before = d.state.base[2];
  d.move(0.5, 0.3, 5.0, kBias);
  // What is left of the bias: exp(-(20 - still_time) / time constant), with 0.3 s and 2 s of
  // control.yaml.
  const double left_over = kBias * std::exp(-(20.0 - 0.3 - 2 * kDt) / 2.0);
  EXPECT_NEAR(d.state.base[2] - before, 0.3 * 5.0, left_over * 5.0 + kRounding);
  EXPECT_NEAR(d.state.gyro[2], 0.3 + kBias, 1e-15) << "the state's gyro is as read";
}

TEST(Estimator, TurningIsNotMistakenForBias) {
  Drive d;
  d.move(0.0, 0.3, 10.0);
  EXPECT_NEAR(d.state.base[2], 3.0, kRounding);
}

TEST(Estimator, EncoderNoiseDoesNotAddUp) {
  Drive d;
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0.0, 1e-4);  // rad
  const double radius = mabi()->config().base.wheel_radius_m;
  double largest = 0;
  for (int i = 0; i < 24000; ++i) {  // a minute
    d.r.t_ns += kPeriodNs;
    const double nl = noise(random), nr = noise(random);
    largest = std::max({largest, std::abs(nl), std::abs(nr)});
    d.r.wheels[0] = {d.left + nl, 0, 0, 0, true};
    d.r.wheels[1] = {d.right + nr, 0, 0, 0, true};
    d.estimator.step(d.r, d.state);
    ASSERT_LE(std::abs(d.state.base[0]), radius * largest + kRounding);
  }
}

// By hand from the URDF: palm 0.73 kg at 0.03 m, two fingers of 0.05 kg at 0.0584 + 0.02 m, E at
// 0.1034 m.
constexpr double kHandMass = 0.73 + 2 * 0.05;
constexpr double kHandComZ = (0.73 * 0.03 + 2 * 0.05 * 0.0784) / kHandMass - 0.1034;

TEST(Estimator, HandsWeightIsRemovedInEveryPosture) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int trial = 0; trial < 20; ++trial) {
    Drive d;
    std::vector<double> q = mabi()->config().ready;
    for (double& v : q) v += uniform(random);
    d.move(0.2, uniform(random), 0.5);  // a wrench does not depend on where the base stands
    const Eigen::Matrix3d R_WE = control_test::hand_pose(d.state.base, q.data()).linear();
    const Eigen::Vector3d weight_E = R_WE.transpose() * Eigen::Vector3d(0, 0, -9.81 * kHandMass);
    const Eigen::Vector3d moment_E = Eigen::Vector3d(0, 0, kHandComZ).cross(weight_E);
    const Eigen::Vector3d push(10, -20, 30), twist(1, 2, -3);
    for (int i = 0; i < 6; ++i) d.r.joints[i].position = q[i];
    Eigen::Vector3d::Map(d.r.wrench.data()) = push + weight_E;
    Eigen::Vector3d::Map(d.r.wrench.data() + 3) = twist + moment_E;
    d.r.wheels[0].velocity = d.r.wheels[1].velocity = 0;
    d.r.gyro = {};
    d.read();
    EXPECT_TRUE(Eigen::Vector3d::Map(d.state.wrench.data()).isApprox(push, 1e-9)) << trial;
    EXPECT_TRUE(Eigen::Vector3d::Map(d.state.wrench.data() + 3).isApprox(twist, 1e-9)) << trial;
  }
}

TEST(Estimator, InvalidReadingsKeepTheLastValue) {
  const double nan = std::nan("");
  for (const bool marked : {true, false}) {  // marked as invalid, or no numbers
    Drive d;
    d.r.wrench = {1, 2, 3, 4, 5, 6};
    d.r.gripper_opening_m = 0.03;
    d.move(0.5, 0.1, 0.1);
    const RobotState before = d.state;
    const double bad = marked ? 99.0 : nan;
    for (int i = 0; i < 6; ++i) d.r.joints[i] = {bad, bad, bad, 0, !marked};
    for (int i = 0; i < 2; ++i) d.r.wheels[i] = {bad, bad, bad, 0, !marked};
    d.r.gyro = d.r.acceleration = {bad, bad, bad};
    d.r.wrench.fill(bad);
    d.r.gripper_opening_m = d.r.gripper_force_n = bad;
    d.r.imu_valid = d.r.wrench_valid = d.r.gripper_valid = !marked;
    d.r.t_ns += kPeriodNs;
    d.estimator.step(d.r, d.state);
    EXPECT_EQ(d.state.t_ns, d.r.t_ns);
    EXPECT_EQ(d.state.base, before.base);
    EXPECT_EQ(d.state.q, before.q);
    EXPECT_EQ(d.state.dq, before.dq);
    EXPECT_EQ(d.state.tau, before.tau);
    EXPECT_EQ(d.state.gyro, before.gyro);
    EXPECT_EQ(d.state.wrench, before.wrench);
    EXPECT_EQ(d.state.gripper_opening_m, before.gripper_opening_m);
  }
}

TEST(Estimator, WithoutImuTheWheelsGiveTheYaw) {
  Drive d;
  d.r.imu_valid = false;
  d.move(0.5, 0.4, 2.0);
  EXPECT_NEAR(d.state.base[2], 0.8, kRounding);
  EXPECT_NEAR(d.state.base_velocity[2], 0.4, kRounding);
}

TEST(Estimator, WheelsThatReportLateDoNotMakeTheBaseJump) {
  Drive d;
  RobotState state;
  Estimator estimator(mabi(), control_test::control_section("estimator"));
  Readings r = d.r;
  r.wheels[0].valid = r.wheels[1].valid = false;
  estimator.step(r, state);
  r = d.r;
  r.t_ns += kPeriodNs;
  estimator.step(r, state);
  EXPECT_EQ(state.base, (std::array<double, 3>{0, 0, 0}));
}

TEST(Estimator, StepDoesNotAllocate) {
  Drive d;
  const std::uint64_t before = thread_allocations();
  d.move(0.5, 0.4, 0.5);
  EXPECT_EQ(thread_allocations(), before);
}

}  // namespace
}  // namespace wb
