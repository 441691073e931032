// What a real-time loop's wake-ups say of this computer: latency, jitter, overruns, and a verdict.
// Pure; job world. Times in ns.
#pragma once
#include <string>
#include <vector>

#include "core/types/time.hpp"

namespace wb {

// What was seen of one run. wake_ns[i]: when cycle i woke, release_ns[i]: when it should have.
struct RtRun {
  TimeNs period_ns = 0, duration_ns = 0;
  std::vector<TimeNs> release_ns, wake_ns;
  long skipped = 0;  // releases that had passed when a cycle was done
  long page_faults = 0;
  long steal_ticks = 0;  // of 10 ms
  bool real_time = false, memory_locked = false;
};

struct RtReport {
  enum class Verdict { kPass, kFail, kInvalid };
  long cycles = 0,
       overruns = 0;  // overruns: cycles that woke after the next release, and skipped ones
  double latency_p50_us = 0, latency_p99_us = 0, latency_p999_us = 0, latency_max_us = 0;
  double jitter_us = 0;      // standard deviation of the intervals between wake-ups
  double jitter_max_us = 0;  // largest deviation of an interval from the releases' own
  Verdict verdict = Verdict::kInvalid;
  std::string reason;  // of a verdict other than pass
};

// A wake-up this late still leaves more than half of a 2.5 ms period to the step.
inline constexpr double kRtLatencyMax_us = 1000;
// A tick of steal in ten seconds; above it the numbers tell of the host, not of this machine.
inline constexpr double kRtStealMax_fraction = 1e-3;

RtReport judge(const RtRun& run);

// Value that `fraction` of the samples do not exceed (nearest rank); sorted, not empty.
TimeNs quantile(const std::vector<TimeNs>& sorted, double fraction);

}  // namespace wb
