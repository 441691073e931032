// The low-level side's rules, without DDS: who may command, and what is let through.
#include <gtest/gtest.h>

#include <cmath>

#include "drivers/dds/low_level/command_admission.hpp"
#include "drivers/dds/low_level/lease_book.hpp"
#include "drivers/dds/low_level/session_clock.hpp"
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

// The admission and what it needs: a holder's lease 7, commands of it.
class CommandAdmissionTest : public CommandFilter {
 protected:
  using Verdict = CommandAdmission::Verdict;
  static msg::JointCommands command(std::uint64_t sequence, std::uint64_t lease = 7) {
    msg::JointCommands c = good();
    c.lease_ = lease;
    c.sequence_ = sequence;
    return c;
  }
  Verdict take(const msg::JointCommands& c) { return admission.take(c, moment, out); }

  CommandAdmission admission{fake_description()};
  CommandAdmission::Moment moment{7, kNow, kMemory, 100, false};
  wb_commands out{};
};

TEST_F(CommandAdmissionTest, TakesTheHoldersCommandsInOrder) {
  admission.begin_lease();
  EXPECT_FALSE(admission.moving());
  EXPECT_EQ(admission.deadline_ns(), INT64_MAX);
  EXPECT_EQ(take(command(3)), Verdict::kApply);
  EXPECT_TRUE(admission.moving());
  EXPECT_EQ(admission.deadline_ns(), 100 + 50'000'000);
  EXPECT_EQ(take(command(3)), Verdict::kRefused);
  EXPECT_STREQ(admission.refusal(), "duplicate or out of order");
  EXPECT_EQ(take(command(2)), Verdict::kRefused);
  EXPECT_EQ(take(command(4, 8)), Verdict::kRefused);
  EXPECT_STREQ(admission.refusal(), "not the holder's lease");
  moment.lease = 0;
  EXPECT_EQ(take(command(5, 0)), Verdict::kRefused) << "nobody's lease is no lease";
  EXPECT_TRUE(admission.end_lease()) << "what moves must be stopped";
}

TEST_F(CommandAdmissionTest, AStopIsLatchedUntilTheNextLease) {
  admission.begin_lease();
  msg::JointCommands stop = command(1);
  stop.stop_ = true;
  stop.stamp_ns_ = 0;  // how old it is makes no difference
  EXPECT_EQ(take(stop), Verdict::kStop);
  EXPECT_EQ(take(command(2)), Verdict::kRefused);
  EXPECT_STREQ(admission.refusal(), "stopped until a new lease");
  stop.sequence_ = 3;
  EXPECT_EQ(take(stop), Verdict::kStopped);
  EXPECT_FALSE(admission.end_lease());
  admission.begin_lease();
  EXPECT_EQ(take(command(1)), Verdict::kApply);
}

TEST_F(CommandAdmissionTest, APacedRobotsCommandIsNotFromBeforeTheClocksBegin) {
  admission.begin_lease();
  moment.memory_ns = 0;
  msg::JointCommands c = command(1);
  c.stamp_ns_ = INT64_MIN;  // the offset to the robot's own time is added to it
  EXPECT_EQ(take(c), Verdict::kRefused);
  EXPECT_STREQ(admission.refusal(), "too old");
}

class SessionClockTest : public ::testing::Test {
 protected:
  using Verdict = SessionClock::Verdict;
  static constexpr TimeNs kFar = INT64_MAX / 4;
  Verdict take(std::uint64_t session, std::uint64_t number, TimeNs t, TimeNs wall = 0) {
    msg::Tick tick{};
    tick.session_ = session;
    tick.number_ = number;
    tick.t_ns_ = t;
    const Verdict verdict = clock.take(tick, wall);
    if (verdict == Verdict::kGoOn) clock.reach(clock.robot_ns(tick));
    if (verdict != Verdict::kRefused && answers) clock.answer(tick);
    return verdict;
  }
  SessionClock clock;
  bool answers = true;
};

TEST_F(SessionClockTest, FollowsOneHostForward) {
  EXPECT_EQ(take(1, 0, 500), Verdict::kAgain) << "number 0 moves nothing";
  EXPECT_EQ(take(1, 1, 510), Verdict::kGoOn);
  EXPECT_EQ(clock.now_ns(), 10) << "the robot's own time begins at 0";
  EXPECT_EQ(take(1, 1, 510), Verdict::kAgain);
  EXPECT_EQ(take(1, 2, 509), Verdict::kRefused) << "back";
  EXPECT_EQ(take(1, 0, 520), Verdict::kRefused) << "out of order";
  EXPECT_EQ(take(2, 1, 0, kNanosPerSecond - 1), Verdict::kRefused) << "the first host is there";
  EXPECT_EQ(take(2, 1, 0, kNanosPerSecond), Verdict::kGoOn);
  EXPECT_EQ(clock.now_ns(), 10);
  EXPECT_EQ(clock.host_ns(), 0);
}

TEST_F(SessionClockTest, TimesFromFarOutsideAnyClockAreRefused) {
  for (const TimeNs t : {INT64_MIN, TimeNs{-1}, kFar + 1, INT64_MAX})
    EXPECT_EQ(take(1, 1, t), Verdict::kRefused) << t;
  // One host after another, each of which lets a very long time pass.
  EXPECT_EQ(take(1, 1, 0), Verdict::kGoOn);
  EXPECT_EQ(take(1, 2, kFar), Verdict::kGoOn);
  EXPECT_EQ(take(2, 1, 0, kNanosPerSecond), Verdict::kGoOn);
  EXPECT_EQ(take(2, 2, 1, kNanosPerSecond), Verdict::kRefused);
}

TEST_F(SessionClockTest, ANewHostsNumbersBeginAnewAlsoIfItsFirstTickFails) {
  EXPECT_EQ(take(1, 9, 0), Verdict::kGoOn);
  answers = false;
  EXPECT_EQ(take(2, 1, 0, kNanosPerSecond), Verdict::kGoOn);
  EXPECT_EQ(take(2, 2, 1, kNanosPerSecond), Verdict::kGoOn);
}

}  // namespace
}  // namespace wb::dds
