// Facts about check_command alone: bounds, extreme stamps, and that nothing unfit passes whatever
// is sent.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <random>

#include "daemon/service/command_check.hpp"

namespace wb {
namespace {

constexpr std::int64_t kNow = 1'700'000'000 * kNanosPerSecond;

CommandRules rules() {
  CommandRules rules;
  rules.objects = {"drawer"};
  rules.joints = {{-1, 1, 1, 1, 1}, {0, 3, 1, 1, 1}};
  rules.weights = {{"end_effector.position_pm2", 80, 0.5, 8000}, {"posture.q", 1, 0, 100}};
  rules.terms = {"end_effector", "posture", "environment"};
  return rules;
}

OperatorCommand command(const char* verb) {
  OperatorCommand command;
  command.request_id = 1;
  command.client = "test";
  command.stamp_ns = kNow;
  command.verb = verb;
  command.object = "drawer";
  return command;
}

TEST(CommandCheck, BoundsThemselvesAreAccepted) {
  for (const double fraction : {0.0, 1.0}) {
    OperatorCommand open = command("open");
    open.opened_fraction = fraction;
    EXPECT_EQ(check_command(open, rules(), kNow).refusal, Refusal::kNone);
  }
  OperatorCommand joints = command("move_joints");
  joints.values = {-1, 3};
  EXPECT_EQ(check_command(joints, rules(), kNow).refusal, Refusal::kNone);
  OperatorCommand base = command("move_base");
  base.values = {50, -50, std::numbers::pi};
  EXPECT_EQ(check_command(base, rules(), kNow).refusal, Refusal::kNone);
  OperatorCommand old = command("open");
  old.stamp_ns = kNow - rules().age_max_ns;
  EXPECT_EQ(check_command(old, rules(), kNow).refusal, Refusal::kNone);
  old.stamp_ns -= 1;
  EXPECT_EQ(check_command(old, rules(), kNow).refusal, Refusal::kStale);
  OperatorCommand early = command("open");
  early.stamp_ns = kNow + rules().future_max_ns;
  EXPECT_EQ(check_command(early, rules(), kNow).refusal, Refusal::kNone);
  early.stamp_ns += 1;
  EXPECT_EQ(check_command(early, rules(), kNow).refusal, Refusal::kStale);
}

TEST(CommandCheck, ExtremeStampsAreStaleAndStopIsNever) {
  for (const std::int64_t stamp : {std::numeric_limits<std::int64_t>::min(), std::int64_t{0},
                                   std::numeric_limits<std::int64_t>::max()}) {
    OperatorCommand open = command("open");
    OperatorCommand stop = command("stop");
    open.stamp_ns = stop.stamp_ns = stamp;
    EXPECT_EQ(check_command(open, rules(), kNow).refusal, Refusal::kStale);
    const CheckedCommand stopped = check_command(stop, rules(), kNow);
    EXPECT_EQ(stopped.refusal, Refusal::kNone);
    EXPECT_EQ(stopped.request.kind, RequestKind::kStop);
  }
}

CheckedCommand tuned(const char* verb, const char* weight, std::vector<double> values) {
  OperatorCommand tune = command(verb);
  tune.object = weight;
  tune.values = std::move(values);
  return check_command(tune, rules(), kNow);
}

TEST(CommandCheck, TuningNamesAWeightAndStaysWithinItsRange) {
  for (const double value : {0.5, 8000.0}) {
    const CheckedCommand good = tuned("tune", "end_effector.position_pm2", {value});
    EXPECT_EQ(good.refusal, Refusal::kNone) << good.reason;
    EXPECT_EQ(good.request.kind, RequestKind::kTune);
    EXPECT_EQ(good.request.weight, 0);
    EXPECT_EQ(good.request.value, value);
  }
  EXPECT_EQ(tuned("tune", "end_effector.position_pm2", {0.4}).refusal, Refusal::kOutOfRange);
  EXPECT_EQ(tuned("tune", "end_effector.position_pm2", {8001}).refusal, Refusal::kOutOfRange);
  EXPECT_EQ(tuned("tune", "end_effector.position_pm2", {std::nan("")}).refusal,
            Refusal::kNotFinite);
  EXPECT_EQ(tuned("tune", "end_effector.position_pm2", {}).refusal, Refusal::kWrongCount);
  EXPECT_EQ(tuned("tune", "end_effector.position_pm2", {1, 2}).refusal, Refusal::kWrongCount);
  EXPECT_EQ(tuned("tune", "", {1}).refusal, Refusal::kUnknownWeight);
}

TEST(CommandCheck, LimitsAndSafetyTermsCannotBeTunedAndTyposGetAGuess) {
  const CheckedCommand safety = tuned("tune", "environment.mu_pm2", {1});
  EXPECT_EQ(safety.refusal, Refusal::kUnknownWeight);
  EXPECT_NE(safety.reason.find("limits and safety terms are fixed"), std::string::npos);
  const CheckedCommand typo = tuned("tune", "end_efector.position_pm2", {1});
  EXPECT_EQ(typo.refusal, Refusal::kUnknownWeight);
  EXPECT_NE(typo.reason.find("did you mean 'end_effector.position_pm2'?"), std::string::npos);
}

TEST(CommandCheck, RevertTakesOneWeightOrAll) {
  const CheckedCommand all = tuned("revert", "", {}), one = tuned("revert", "posture.q", {});
  EXPECT_EQ(all.refusal, Refusal::kNone);
  EXPECT_EQ(all.request.kind, RequestKind::kRevert);
  EXPECT_EQ(all.request.weight, -1);
  EXPECT_EQ(one.refusal, Refusal::kNone);
  EXPECT_EQ(one.request.weight, 1);
  EXPECT_EQ(tuned("revert", "posture.p", {}).refusal, Refusal::kUnknownWeight);
  EXPECT_EQ(tuned("revert", "", {1}).refusal, Refusal::kWrongCount);
}

TEST(CommandCheck, FixedBaseTakesNoBaseGoal) {
  CommandRules fixed = rules();
  fixed.mobile_base = false;
  OperatorCommand base = command("move_base");
  base.values = {0, 0, 0};
  EXPECT_EQ(check_command(base, fixed, kNow).refusal, Refusal::kUnknownVerb);
}

TEST(CommandCheck, ReasonsHoldNoControlCharacters) {
  OperatorCommand open = command("open");
  open.object = "a\x1b[2Jb\nc";
  const CheckedCommand checked = check_command(open, rules(), kNow);
  EXPECT_EQ(checked.refusal, Refusal::kUnknownObject);
  EXPECT_EQ(checked.reason, "no object 'a?[2Jb?c'; known: drawer");
}

TEST(CommandCheck, WhateverIsSentOnlyFitRequestsPass) {
  std::mt19937_64 random(1);
  const double kNaN = std::numeric_limits<double>::quiet_NaN();
  const std::vector<const char*> verbs{"open",      "stop", "reset", "move_joints",
                                       "move_base", "",     "OPEN"};
  const std::vector<const char*> objects{"drawer", "", "oven", "drawer "};
  const std::vector<double> numbers{0,  0.5, 1,      -1,   2,        3.5,
                                    49, 51,  -1e300, kNaN, HUGE_VAL, -HUGE_VAL};
  const auto pick = [&](const auto& from) { return from[random() % from.size()]; };
  int passed = 0;
  for (int i = 0; i < 20000; ++i) {
    OperatorCommand c = command(pick(verbs));
    c.object = pick(objects);
    c.opened_fraction = pick(numbers);
    c.values.resize(random() % 5);
    for (double& v : c.values) v = pick(numbers);
    const CheckedCommand checked = check_command(c, rules(), kNow);
    if (checked.refusal != Refusal::kNone) {
      EXPECT_FALSE(checked.reason.empty());
      EXPECT_EQ(checked.request.kind, RequestKind::kNone);
      continue;
    }
    ++passed;
    const Request& r = checked.request;
    ASSERT_NE(r.kind, RequestKind::kNone);
    ASSERT_TRUE(r.opened_fraction >= 0 && r.opened_fraction <= 1);
    ASSERT_EQ(r.object.view(), r.kind == RequestKind::kOpen ? "drawer" : "");
    ASSERT_EQ(r.joint_count, r.kind == RequestKind::kMoveJoints ? 2 : 0);
    for (int j = 0; j < r.joint_count; ++j) {
      ASSERT_TRUE(r.q[j] >= rules().joints[j].lower && r.q[j] <= rules().joints[j].upper);
    }
    ASSERT_TRUE(std::abs(r.base[0]) <= 50 && std::abs(r.base[1]) <= 50 &&
                std::abs(r.base[2]) <= 3.15);
  }
  EXPECT_GT(passed, 1000);  // the generator does reach the good ones
}

TEST(Domain, ComesFromTheEnvironmentAndMustBeANumber) {
  unsetenv("ROS_DOMAIN_ID");
  EXPECT_EQ(domain_from_environment(), 0);
  setenv("ROS_DOMAIN_ID", "232", 1);
  EXPECT_EQ(domain_from_environment(), 232);
  for (const char* bad : {"233", "-1", "7x", " 7", "seven"}) {
    setenv("ROS_DOMAIN_ID", bad, 1);
    EXPECT_THROW(domain_from_environment(), std::runtime_error) << bad;
  }
}

}  // namespace
}  // namespace wb
