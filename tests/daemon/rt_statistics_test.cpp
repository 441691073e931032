// The statistics and the verdict of `wbctl rt-test`, on wake-ups written by hand.
#include "daemon/wbctl/rt_statistics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

namespace wb {
namespace {

using Verdict = RtReport::Verdict;

// Cycles that wake this late [us], everything else as it should be.
RtRun run(const std::vector<int>& late_us) {
  RtRun r;
  r.period_ns = 2'500'000;
  r.duration_ns = 10 * kNanosPerSecond;
  r.real_time = r.memory_locked = true;
  for (std::size_t i = 0; i < late_us.size(); ++i) {
    r.release_ns.push_back(static_cast<TimeNs>(i) * r.period_ns);
    r.wake_ns.push_back(r.release_ns.back() + 1000 * late_us[i]);
  }
  return r;
}

TEST(RtStatistics, QuantileIsTheNearestRank) {
  std::vector<TimeNs> v(1000);
  std::iota(v.begin(), v.end(), 1);  // 1 to 1000
  EXPECT_EQ(quantile(v, 0.5), 500);
  EXPECT_EQ(quantile(v, 0.99), 990);
  EXPECT_EQ(quantile(v, 0.999), 999);
  EXPECT_EQ(quantile(v, 1.0), 1000);
  EXPECT_EQ(quantile(v, 0.0), 1);
  EXPECT_EQ(quantile({7}, 0.99), 7);
}

TEST(RtStatistics, LatencyIsTheWakeUpAfterItsRelease) {
  std::vector<int> late(1000, 10);
  late[500] = 900;
  late[700] = 40;
  const RtReport r = judge(run(late));
  EXPECT_EQ(r.cycles, 1000);
  EXPECT_DOUBLE_EQ(r.latency_p50_us, 10);
  EXPECT_DOUBLE_EQ(r.latency_p99_us, 10);
  EXPECT_DOUBLE_EQ(r.latency_p999_us, 40);
  EXPECT_DOUBLE_EQ(r.latency_max_us, 900);
}

TEST(RtStatistics, JitterIsOfTheIntervalsBetweenWakeUps) {
  // Intervals deviate by +30, -30, 0 us: a constant lateness is no jitter.
  const RtReport r = judge(run({100, 130, 100, 100}));
  EXPECT_DOUBLE_EQ(r.jitter_max_us, 30);
  EXPECT_NEAR(r.jitter_us, std::sqrt((900.0 + 900.0) / 3), 1e-9);
  EXPECT_DOUBLE_EQ(judge(run({100, 100, 100})).jitter_us, 0);
}

TEST(RtStatistics, PunctualRunPasses) {
  const RtReport r = judge(run({10, 20, 999}));
  EXPECT_EQ(r.verdict, Verdict::kPass);
  EXPECT_EQ(r.reason, "");
}

TEST(RtStatistics, EachFaultFailsTheRunByName) {
  EXPECT_EQ(judge(run({10, 1001, 20})).reason, "woke up to 1001 us late");
  RtRun r = run({10, 20});
  r.skipped = 3;
  EXPECT_EQ(judge(r).verdict, Verdict::kFail);
  EXPECT_EQ(judge(r).reason, "3 overruns");
  r = run({10, 20});
  r.page_faults = 2;
  EXPECT_EQ(judge(r).reason, "2 page faults");
  r = run({10, 20});
  r.real_time = r.memory_locked = false;
  EXPECT_EQ(judge(r).reason, "no SCHED_FIFO, memory not locked");
  EXPECT_EQ(judge(r).verdict, Verdict::kFail);
}

TEST(RtStatistics, NoVerdictWhereTimeWasStolen) {
  RtRun r = run({10, 5000});
  r.steal_ticks = 4;
  EXPECT_EQ(judge(r).verdict, Verdict::kInvalid);
  EXPECT_EQ(judge(r).reason, "4 ticks stolen");
  // One tick in ten seconds is near zero: the verdict stands.
  r.steal_ticks = 1;
  EXPECT_EQ(judge(r).verdict, Verdict::kFail);
  r = run({10});
  r.steal_ticks = 1;
  EXPECT_EQ(judge(r).verdict, Verdict::kPass);
}

TEST(RtStatistics, NoCycleIsNoVerdict) { EXPECT_EQ(judge(run({})).verdict, Verdict::kInvalid); }

}  // namespace
}  // namespace wb
