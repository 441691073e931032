#include "core/rt/executor.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace wb {
namespace {

TEST(Executor, ReleasesStandAtTheCeilingOfWholeNanoseconds) {
  EXPECT_EQ(release_time(0, 30), 0);
  EXPECT_EQ(release_time(1, 30), 33'333'334);
  EXPECT_EQ(release_time(3, 30), 100'000'000);
  EXPECT_EQ(release_time(30'000'000, 30), 1'000'000 * kNanosPerSecond);
  EXPECT_EQ(release_time(1, 400), 2'500'000);
}

TEST(Lockstep, RunsPlantThenDeliveriesThenLoopsInOrderOfAdding) {
  std::vector<std::string> log;
  Lockstep lockstep([&](TimeNs t) { log.push_back("plant " + std::to_string(t / 1'000'000)); });
  lockstep.add({"control", 100, 0, 0, [&](TimeNs) { log.push_back("control"); }, {}});
  lockstep.add({"mpc", 50, 10'000'000, 0, [&](TimeNs) { log.push_back("mpc"); },
                [&] { log.push_back("policy"); }});
  for (int i = 0; i < 3; ++i) lockstep.run_next();
  EXPECT_EQ(log, (std::vector<std::string>{"plant 0", "control", "mpc", "plant 10", "policy",
                                           "control", "plant 20", "control", "mpc"}));
}

TEST(Lockstep, SkipsAndCountsReleasesWhileAResultIsOnTheWay) {
  int steps = 0, deliveries = 0;
  Lockstep lockstep({});
  lockstep.add({"slow", 100, 25'000'000, 0, [&](TimeNs) { ++steps; }, [&] { ++deliveries; }});
  while (lockstep.now() < 60'000'000) lockstep.run_next();
  EXPECT_EQ(steps, 3);  // at 0, 30 and 60 ms
  EXPECT_EQ(deliveries, 2);
  EXPECT_EQ(lockstep.counters(0).overruns.load(), 4u);  // 10, 20, 40, 50 ms
}

TEST(Executor, LoopWithoutARateIsRefused) {
  Lockstep lockstep({});
  EXPECT_THROW(lockstep.add({"none", 0, 0, 0, [](TimeNs) {}, {}}), std::invalid_argument);
}

TEST(RealTime, RunsEveryLoopAndStops) {
  std::atomic<int> a{0}, b{0};
  RealTime executor;
  executor.add({"a", 500, 0, 0, [&](TimeNs) { ++a; }, {}});
  executor.add({"b", 200, 0, 0, [&](TimeNs) { ++b; }, {}});
  executor.start();
  while (a < 20 || b < 8) std::this_thread::yield();
  executor.stop();
  const int stopped_at = a;
  EXPECT_EQ(executor.counters(0).cycles.load(), static_cast<std::uint64_t>(stopped_at));
}

TEST(RealTime, MissedReleasesAreSkippedNotRunInABurst) {
  std::vector<TimeNs> times;
  std::atomic<int> cycles{0};
  RealTime executor;
  executor.add({"late",
                1000,
                0,
                0,
                [&](TimeNs now) {
                  times.push_back(now);
                  if (++cycles == 3) std::this_thread::sleep_for(std::chrono::milliseconds(20));
                },
                {}});
  executor.start();
  while (cycles < 6) std::this_thread::yield();
  executor.stop();
  // A burst would run the 19 missed cycles within the next period.
  EXPECT_GE(executor.counters(0).overruns.load(), 18u);
}

}  // namespace
}  // namespace wb
