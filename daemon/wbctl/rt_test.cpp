#include "daemon/wbctl/rt_test.hpp"

#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <cstdio>
#include <thread>

#include "core/rt/executor.hpp"
#include "daemon/json.hpp"
#include "daemon/steal.hpp"
#include "daemon/wbctl/rt_statistics.hpp"

namespace wb {
namespace {

constexpr double kRate_hz = 400;         // the control loop's
constexpr int kPriority = 80;            // and its priority
constexpr TimeNs kLead_ns = 20'000'000;  // before the first release: the thread gets its priority

long page_faults() {
  rusage use{};
  getrusage(RUSAGE_THREAD, &use);
  return use.ru_minflt + use.ru_majflt;
}

void loop(RtRun& run, std::size_t cycles) {
  const TimeNs start = RealTime::monotonic() + kLead_ns;
  long faults = 0;
  std::uint64_t k = 0;
  while (run.wake_ns.size() < cycles) {
    const TimeNs release = start + release_time(k, kRate_hz);
    const timespec at{release / kNanosPerSecond, release % kNanosPerSecond};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
    const TimeNs woken = RealTime::monotonic();
    if (k == 0) faults = page_faults();
    run.release_ns.push_back(release);
    run.wake_ns.push_back(woken);
    // As the executor does: releases that have passed are skipped, never caught up.
    for (++k; start + release_time(k, kRate_hz) <= woken; ++k) ++run.skipped;
  }
  run.page_faults = page_faults() - faults;
}

RtRun measure(double seconds) {
  RtRun run;
  const auto cycles = static_cast<std::size_t>(seconds * kRate_hz);
  run.period_ns = from_seconds(1 / kRate_hz);
  run.release_ns.reserve(cycles);
  run.wake_ns.reserve(cycles);
  run.memory_locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
  const long steal = steal_ticks();
  const TimeNs start = RealTime::monotonic();
  std::thread thread([&] { loop(run, cycles); });
  sched_param param{};
  param.sched_priority = kPriority;
  const bool real_time = pthread_setschedparam(thread.native_handle(), SCHED_FIFO, &param) == 0;
  thread.join();
  run.real_time = real_time;
  run.duration_ns = RealTime::monotonic() - start;
  run.steal_ticks = steal_ticks() - steal;
  return run;
}

}  // namespace

int rt_test_main(double seconds, bool json) {
  const RtRun run = measure(seconds);
  const RtReport r = judge(run);
  const char* verdict = r.verdict == RtReport::Verdict::kPass   ? "pass"
                        : r.verdict == RtReport::Verdict::kFail ? "fail"
                                                                : "invalid";
  if (json) {
    Json out = Json::object();
    out.add("verb", "rt-test").add("verdict", verdict).add("reason", r.reason);
    out.add("rate_hz", kRate_hz).add("cycles", std::int64_t{r.cycles});
    out.add("overruns", std::int64_t{r.overruns}).add("latency_p50_us", r.latency_p50_us);
    out.add("latency_p99_us", r.latency_p99_us).add("latency_p999_us", r.latency_p999_us);
    out.add("latency_max_us", r.latency_max_us).add("jitter_us", r.jitter_us);
    out.add("jitter_max_us", r.jitter_max_us).add("page_faults", std::int64_t{run.page_faults});
    out.add("steal_ticks", std::int64_t{run.steal_ticks});
    out.add("sched_fifo", run.real_time).add("memory_locked", run.memory_locked);
    std::printf("%s\n", out.str().c_str());
  } else {
    std::printf("wake-ups at %.0f Hz, SCHED_FIFO %d: %ld cycles in %.1f s\n", kRate_hz, kPriority,
                r.cycles, to_seconds(run.duration_ns));
    std::printf("latency  %.0f / %.0f / %.0f / %.0f us (median, p99, p99.9, largest)\n",
                r.latency_p50_us, r.latency_p99_us, r.latency_p999_us, r.latency_max_us);
    std::printf("jitter   %.0f us (standard deviation), %.0f us largest\n", r.jitter_us,
                r.jitter_max_us);
    std::printf("overruns %ld, page faults %ld, steal %ld ticks of 10 ms\n", r.overruns,
                run.page_faults, run.steal_ticks);
    std::printf("%s%s%s\n", verdict, r.reason.empty() ? "" : ": ", r.reason.c_str());
  }
  return static_cast<int>(r.verdict);
}

}  // namespace wb
