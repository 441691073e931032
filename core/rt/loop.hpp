// A loop as both executors see it: what to run, how often, and what to hand over afterwards; and
// its counters. The step itself reads no clock; the executor hands it the time.
#pragma once
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string>

#include "core/types/time.hpp"

namespace wb {

struct Loop {
  std::string name;
  double rate_hz = 0;
  TimeNs latency_ns = 0;             // Lockstep: results are delivered this long after the release
  int priority = 0;                  // RealTime: SCHED_FIFO priority, 0 = ordinary thread
  std::function<void(TimeNs)> step;  // computes; must not publish
  std::function<void()> deliver;     // publishes what step computed; may be empty
};

// Distribution of durations in buckets a factor 2^(1/4) apart, from 1 us to 16 s. One writer, any
// readers.
class DurationHistogram {
 public:
  void add(TimeNs ns) noexcept {
    const double us = 1e-3 * static_cast<double>(ns);
    const int bucket =
        us > 1.0 ? std::min(kBuckets - 1, static_cast<int>(4.0 * std::log2(us)) + 1) : 0;
    counts_[bucket].fetch_add(1, std::memory_order_relaxed);
    if (ns > max_ns_.load(std::memory_order_relaxed)) max_ns_.store(ns, std::memory_order_relaxed);
  }
  // Duration [us] that `fraction` of the samples do not exceed, rounded up to its bucket's edge (19
  // %) but not above the largest.
  double quantile_us(double fraction) const noexcept {
    std::uint64_t total = 0, below = 0;
    for (const auto& n : counts_) total += n.load(std::memory_order_relaxed);
    for (int i = 0; i < kBuckets; ++i) {
      below += counts_[i].load(std::memory_order_relaxed);
      if (static_cast<double>(below) >= fraction * static_cast<double>(total))
        return std::min(max_us(), std::exp2(0.25 * i));
    }
    return max_us();
  }
  double max_us() const noexcept {
    return 1e-3 * static_cast<double>(max_ns_.load(std::memory_order_relaxed));
  }

 private:
  static constexpr int kBuckets = 97;
  std::array<std::atomic<std::uint64_t>, kBuckets> counts_{};
  std::atomic<TimeNs> max_ns_{0};
};

// Counters of one loop. Written by its thread, read by anyone.
struct LoopCounters {
  std::atomic<std::uint64_t> cycles{0};
  std::atomic<std::uint64_t> overruns{
      0};                               // releases skipped because the previous step was not done
  std::atomic<std::int64_t> cpu_ns{0};  // thread CPU time spent in step and deliver
  DurationHistogram cpu;                // of one cycle's step
  DurationHistogram late;               // wake-up after the release (RealTime)
};

}  // namespace wb
