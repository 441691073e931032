// PoseHistory: interpolation and what it refuses.
#include "mapping/pose_history.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace wb {
namespace {

constexpr TimeNs kTick = 2'500'000;

RobotState state_at(TimeNs t) {
  RobotState s;
  s.t_ns = t;
  s.joint_count = 2;
  const double seconds = to_seconds(t);
  s.base = {seconds, -2 * seconds, 0.5 * seconds};
  s.q[0] = 3 * seconds;
  s.q[1] = -seconds;
  return s;
}

TEST(PoseHistory, InterpolatesLinearlyAndReachesBackASecond) {
  PoseHistory history(3, 2);
  for (int i = 0; i < 2000; ++i) history.push(state_at(i * kTick));
  const TimeNs newest = 1999 * kTick;
  PoseHistory::State x;
  for (TimeNs t = newest - kNanosPerSecond; t <= newest; t += 777'777) {
    ASSERT_TRUE(history.at(t, x));
    const double s = to_seconds(t);
    const double expected[] = {s, -2 * s, 0.5 * s, 3 * s, -s};
    for (int i = 0; i < 5; ++i) EXPECT_NEAR(x[i], expected[i], 1e-12);
  }
}

TEST(PoseHistory, RefusesTheFutureAndThePast) {
  PoseHistory history(3, 2);
  PoseHistory::State x;
  EXPECT_FALSE(history.at(0, x));
  for (int i = 0; i < 2000; ++i) history.push(state_at(i * kTick));
  const TimeNs newest = 1999 * kTick, oldest = newest - (PoseHistory::kCapacity - 1) * kTick;
  EXPECT_TRUE(history.at(newest + PoseHistory::kFutureNs, x));
  EXPECT_EQ(x[0], state_at(newest).base[0]);
  EXPECT_FALSE(history.at(newest + PoseHistory::kFutureNs + 1, x));
  EXPECT_TRUE(history.at(oldest, x));
  EXPECT_FALSE(history.at(oldest - 1, x));
}

TEST(PoseHistory, IgnoresStatesThatCannotBe) {
  PoseHistory history(3, 2);
  history.push(state_at(kTick));
  history.push(state_at(kTick));
  history.push(state_at(0));
  RobotState bad = state_at(2 * kTick);
  bad.q[1] = std::numeric_limits<double>::quiet_NaN();
  history.push(bad);
  bad = state_at(2 * kTick);
  bad.joint_count = 3;
  history.push(bad);
  PoseHistory::State x;
  EXPECT_FALSE(history.at(0, x));
  ASSERT_TRUE(history.at(2 * kTick, x));  // held from the first, within the future that is allowed
  EXPECT_EQ(x[0], state_at(kTick).base[0]);
}

TEST(PoseHistory, FixedBaseHoldsJointsAlone) {
  PoseHistory history(0, 2);
  history.push(state_at(kNanosPerSecond));
  PoseHistory::State x;
  ASSERT_TRUE(history.at(kNanosPerSecond, x));
  EXPECT_EQ(x[0], 3.0);
  EXPECT_EQ(history.newest_base(), (std::array<double, 2>{0.0, 0.0}));
}

}  // namespace
}  // namespace wb
