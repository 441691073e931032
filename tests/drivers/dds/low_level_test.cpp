// The low-level side's rules, without DDS: who may command, and what is let through.
#include <gtest/gtest.h>

#include <cmath>

#include "drivers/dds/low_level/command_filter.hpp"
#include "drivers/dds/low_level/lease_book.hpp"
#include "tests/drivers/dds/fake_robot.hpp"

namespace wb::dds {
namespace {

TEST(LeaseBook, HasOneHolderAtATime) {
  LeaseBook book(100);
  const auto first = book.ask(1, "alice", 0);
  EXPECT_NE(first.lease, 0u);
  EXPECT_TRUE(first.is_new);
  const auto second = book.ask(2, "bob", 50);
  EXPECT_EQ(second.lease, 0u);
  EXPECT_EQ(second.reason, "held by alice");
  EXPECT_FALSE(book.release(2));
  EXPECT_TRUE(book.release(1));
  EXPECT_NE(book.ask(2, "bob", 60).lease, first.lease);
}

TEST(LeaseBook, EndsWithSilence) {
  LeaseBook book(100);
  const std::uint64_t lease = book.ask(1, "alice", 0).lease;
  EXPECT_FALSE(book.expire(100));
  EXPECT_EQ(book.ask(1, "alice", 100).lease, lease) << "asking again keeps it";
  EXPECT_FALSE(book.expire(200));
  book.heard(150);
  EXPECT_FALSE(book.expire(250));
  EXPECT_TRUE(book.expire(251));
  EXPECT_EQ(book.lease(), 0u);
  EXPECT_EQ(book.ask(1, "alice", 252).reason, "this claim has ended");
  EXPECT_NE(book.ask(2, "bob", 252).lease, 0u);
}

class CommandFilter : public ::testing::Test {
 protected:
  static constexpr TimeNs kNow = 5 * kNanosPerSecond, kMemory = 100'000'000;
  static msg::JointCommands good() {
    msg::JointCommands c{};
    c.stamp_ns_ = kNow;
    c.valid_for_ns_ = 50'000'000;
    c.joint_count_ = 5;
    for (int i = 0; i < 5; ++i) c.kind_[i] = i < 3 ? WB_CMD_IMPEDANCE : WB_CMD_VELOCITY;
    return c;
  }
  static std::string reason(const msg::JointCommands& c) {
    const char* r = refuse(c, fake_description(), kNow, kMemory);
    return r ? r : "";
  }
};

TEST_F(CommandFilter, SaysWhyItRefuses) {
  EXPECT_EQ(reason(good()), "");
  const auto with = [](auto&& change) {
    msg::JointCommands c = good();
    change(c);
    return reason(c);
  };
  EXPECT_EQ(with([](auto& c) { c.joint_count_ = 4; }), "wrong number of joints");
  EXPECT_EQ(with([](auto& c) { c.joint_count_ = 0; }), "") << "the gripper alone";
  EXPECT_EQ(with([](auto& c) { c.valid_for_ns_ = 0; }), "valid_for out of range");
  EXPECT_EQ(with([](auto& c) { c.valid_for_ns_ = INT64_MAX; }), "valid_for out of range");
  EXPECT_EQ(with([](auto& c) { c.stamp_ns_ = kNow + 5'000'001; }), "from the future");
  EXPECT_EQ(with([](auto& c) { c.stamp_ns_ = INT64_MIN; }), "too old");
  EXPECT_EQ(with([](auto& c) { c.stamp_ns_ = kNow - kMemory - 1; }), "too old");
  EXPECT_EQ(with([](auto& c) { c.kind_[0] = 9; }), "unknown command kind");
  EXPECT_EQ(with([](auto& c) { c.kind_[4] = WB_CMD_IMPEDANCE; }),
            "a joint does not take this kind of command");
  EXPECT_EQ(with([](auto& c) { c.position_[1] = NAN; }), "not finite");
  EXPECT_EQ(with([](auto& c) { c.effort_[3] = INFINITY; }), "not finite");
  EXPECT_EQ(with([](auto& c) { c.damping_[2] = -1; }), "negative gain");
  EXPECT_EQ(with([](auto& c) {
              c.has_gripper_ = true;
              c.gripper_opening_ = NAN;
            }),
            "not finite");
}

TEST_F(CommandFilter, ClipsToEachJointsLimits) {
  msg::JointCommands c = good();
  c.position_[0] = -7;
  c.velocity_[0] = 7;
  c.effort_[0] = -70;
  c.stiffness_[0] = 500;
  c.velocity_[4] = -7;
  wb_commands out;
  clip(c, fake_description(), out);
  EXPECT_EQ(out.joints[0].position, -2);
  EXPECT_EQ(out.joints[0].velocity, 1.5);
  EXPECT_EQ(out.joints[0].effort, -20);
  EXPECT_EQ(out.joints[0].stiffness, 500);
  EXPECT_EQ(out.joints[4].velocity, -1.5);
  c.kind_[0] = WB_CMD_NONE;
  clip(c, fake_description(), out);
  EXPECT_EQ(out.joints[0].kind, static_cast<std::uint32_t>(WB_CMD_NONE));
  EXPECT_EQ(out.joints[0].position, 0);
}

}  // namespace
}  // namespace wb::dds
