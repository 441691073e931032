// What the checks of joint, IMU and wrench samples let through, without DDS.
#include "drivers/dds/samples.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace wb::dds {
namespace {

constexpr TimeNs kNow = 1'700'000'000 * kNanosPerSecond;
constexpr Arrival kArrival{kNow, 50'000'000};
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

class MeasurementGateTest : public ::testing::Test {
 protected:
  MeasurementGateTest() { gate.expect(7, 3, {2, 0}, 0); }

  static msg::JointMeasurements good(std::uint64_t sequence) {
    msg::JointMeasurements m{};
    m.boot_ = 7;
    m.sequence_ = sequence;
    m.stamp_ns_ = kNow - 10'000'000 + static_cast<TimeNs>(sequence) * 1'000'000;
    m.joint_count_ = 3;
    for (int i = 0; i < 3; ++i) {
      m.valid_[i] = true;
      m.status_[i] = WB_JOINT_FOLLOWING;
      m.position_[i] = i + 0.5;
    }
    return m;
  }
  Fault take(const msg::JointMeasurements& m) { return gate.convert(m, kArrival, sample); }

  MeasurementGate gate;
  Sample sample;
};

TEST_F(MeasurementGateTest, PutsJointsIntoThePluginsOrder) {
  msg::JointMeasurements m = good(1);
  m.age_ns_[2] = 1'000;
  m.error_[0] = 5;
  m.status_[0] = WB_JOINT_FAULT;
  ASSERT_EQ(take(m), Fault::kNone);
  EXPECT_EQ(sample.readings.joints[0].position, 2.5);
  EXPECT_EQ(sample.readings.joints[0].age_ns, 1'000);
  EXPECT_EQ(sample.readings.joints[1].position, 0.5);
  EXPECT_EQ(sample.readings.joints[1].error_code, 5u);
  EXPECT_EQ(sample.readings.joints[1].status, static_cast<std::uint32_t>(WB_JOINT_FAULT));
  EXPECT_EQ(sample.readings.joints[2].valid, 0u);
}

TEST_F(MeasurementGateTest, NamesEachKindOfFault) {
  ASSERT_EQ(take(good(5)), Fault::kNone);
  EXPECT_EQ(take(good(5)), Fault::kDuplicate);
  EXPECT_EQ(take(good(4)), Fault::kOutOfOrder);
  const auto with = [](auto&& change) {
    msg::JointMeasurements m = good(6);
    change(m);
    return m;
  };
  EXPECT_EQ(take(with([](auto& m) { m.boot_ = 8; })), Fault::kWrongSource);
  EXPECT_EQ(take(with([](auto& m) { m.session_ = 1; })), Fault::kWrongSource);
  EXPECT_EQ(take(with([](auto& m) { m.joint_count_ = 4; })), Fault::kWrongSize);
  EXPECT_EQ(take(with([](auto& m) { m.stamp_ns_ = -1; })), Fault::kMalformed);
  EXPECT_EQ(take(with([](auto& m) { m.stamp_ns_ = INT64_MAX; })), Fault::kMalformed);
  EXPECT_EQ(take(with([](auto& m) { m.stamp_ns_ = kNow + 5'000'001; })), Fault::kFuture);
  EXPECT_EQ(take(with([](auto& m) { m.stamp_ns_ = kNow - 50'000'001; })), Fault::kStale);
  EXPECT_EQ(take(with([](auto& m) { m.stamp_ns_ = good(5).stamp_ns_; })), Fault::kFrozen);
  EXPECT_EQ(take(with([](auto& m) { m.status_[2] = 6; })), Fault::kMalformed);
  EXPECT_EQ(take(with([](auto& m) { m.age_ns_[0] = -1; })), Fault::kMalformed);
  EXPECT_EQ(take(with([](auto& m) { m.velocity_[2] = kNaN; })), Fault::kNonFinite);
  EXPECT_EQ(take(with([](auto& m) {
              m.imu_valid_ = true;
              m.gyro_[1] = INFINITY;
            })),
            Fault::kNonFinite);
  EXPECT_EQ(take(with([](auto& m) {
              m.gripper_valid_ = true;
              m.gripper_force_ = kNaN;
            })),
            Fault::kNonFinite);
  // None of them has moved the gate, and what is not valid or not ours may hold anything.
  EXPECT_EQ(take(with([](auto& m) {
              m.position_[1] = kNaN;  // not one of the plugin's joints
              m.valid_[2] = false;
              m.position_[2] = kNaN;
              m.stamp_ns_ = kNow + 5'000'000;
            })),
            Fault::kNone);
  EXPECT_EQ(sample.readings.joints[0].valid, 0u);
  EXPECT_EQ(sample.readings.joints[0].position, 0.0);
}

TEST_F(MeasurementGateTest, AnotherStartIsAnotherStream) {
  ASSERT_EQ(take(good(500)), Fault::kFuture);
  ASSERT_EQ(take(good(9)), Fault::kNone);
  gate.expect(8, 3, {0}, 0);
  EXPECT_EQ(take(good(10)), Fault::kWrongSource);
  msg::JointMeasurements m = good(1);
  m.boot_ = 8;
  EXPECT_EQ(take(m), Fault::kNone);
}

TEST_F(MeasurementGateTest, APacedRobotMayAnswerTwiceAtOneTime) {
  gate.expect(7, 3, {0}, 99);
  msg::JointMeasurements m = good(1);
  m.session_ = 99;
  ASSERT_EQ(take(m), Fault::kNone);
  m.sequence_ = 2;
  EXPECT_EQ(take(m), Fault::kNone);
  m.sequence_ = 3;
  m.stamp_ns_ -= 1;
  EXPECT_EQ(take(m), Fault::kFrozen);
}

TEST(Quality, IsTheShareOfTheLastSecondsSamplesThatCame) {
  Quality quality;
  double share = 0;
  std::uint64_t sequence = 0;
  // 100 Hz, every fourth sample lost.
  for (int k = 1; k <= 200; ++k) {
    if (k % 4 != 0) share = quality.add(sequence = k, k * TimeNs{10'000'000});
  }
  EXPECT_NEAR(share, 0.75, 0.01);
  // A second without losses forgets them.
  for (int k = 201; k <= 310; ++k) share = quality.add(sequence = k, k * TimeNs{10'000'000});
  EXPECT_NEAR(share, 1, 0.01);
}

TEST(StampGate, RefusesStampsThatDoNotGrow) {
  StampGate gate;
  EXPECT_EQ(gate.check(kNow, kArrival), Fault::kNone);
  EXPECT_EQ(gate.check(kNow, kArrival), Fault::kDuplicate);
  EXPECT_EQ(gate.check(kNow - 1, kArrival), Fault::kOutOfOrder);
  EXPECT_EQ(gate.check(kNow + 5'000'001, kArrival), Fault::kFuture);
  EXPECT_EQ(gate.check(kNow - 50'000'001, kArrival), Fault::kStale);
  EXPECT_EQ(gate.check(-1, kArrival), Fault::kMalformed);
}

TEST(ImuAndWrench, AreTakenFromRossMessages) {
  StampGate gate, other;
  msg::Imu imu{};
  imu.header_.stamp_ = to_message(kNow);
  imu.angular_velocity_ = {1, 2, 3};
  imu.linear_acceleration_ = {4, 5, 6};
  ImuSample i;
  ASSERT_EQ(convert(imu, kArrival, gate, i), Fault::kNone);
  EXPECT_EQ(i.stamp_ns, kNow);
  EXPECT_EQ(i.gyro[2], 3);
  EXPECT_EQ(i.acceleration[0], 4);
  imu.angular_velocity_.y_ = kNaN;
  EXPECT_EQ(convert(imu, kArrival, gate, i), Fault::kNonFinite);
  msg::WrenchStamped wrench{};
  wrench.header_.stamp_ = {5, 2'000'000'000};
  wrench.wrench_.force_.z_ = 9;
  WrenchSample w;
  EXPECT_EQ(convert(wrench, kArrival, other, w), Fault::kMalformed);
  wrench.header_.stamp_ = to_message(kNow - 1);
  ASSERT_EQ(convert(wrench, kArrival, other, w), Fault::kNone);
  EXPECT_EQ(w.force[2], 9);
  EXPECT_EQ(w.stamp_ns, kNow - 1);
}

}  // namespace
}  // namespace wb::dds
