// The two executors. Lockstep: one thread, virtual clock, fixed order, results delivered after
// their declared latency. RealTime: a thread for each loop, absolute wake-ups on CLOCK_MONOTONIC,
// missed releases are skipped, never caught up. Releases of a loop stand at start + ceil(k / rate)
// in integer nanoseconds (DESIGN.md, "Contracts").
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/rt/loop.hpp"

namespace wb {

// Time of the k-th release after the start: ceil(k * 1e9 / rate).
TimeNs release_time(std::uint64_t k, double rate_hz);

class Lockstep {
 public:
  // advance_plant(t): brings the simulated drivers to t, called before anything else at each
  // instant with an event.
  explicit Lockstep(std::function<void(TimeNs)> advance_plant);
  void add(Loop loop);  // the order of adding is the order at equal times
  TimeNs now() const { return now_; }
  // Runs everything that is due at the next instant with an event; returns that instant.
  TimeNs run_next();
  const LoopCounters& counters(std::size_t loop) const { return *entries_[loop].counters; }
  const Loop& loop(std::size_t i) const { return entries_[i].loop; }
  std::size_t loops() const { return entries_.size(); }

 private:
  static constexpr TimeNs kNever = INT64_MAX;
  struct Entry {
    Loop loop;
    std::uint64_t k = 0;
    TimeNs release = 0;
    TimeNs due = kNever;  // when the pending result is delivered
    std::unique_ptr<LoopCounters> counters;
  };
  std::function<void(TimeNs)> advance_plant_;
  std::vector<Entry> entries_;
  TimeNs now_ = 0;
};

class RealTime {
 public:
  // Steps are handed CLOCK_MONOTONIC minus `epoch`: 0 beside real drivers, the start beside a
  // simulated plant (whose time begins at 0).
  explicit RealTime(TimeNs epoch = 0) : epoch_(epoch) {}
  ~RealTime();
  void add(Loop loop);
  // Starts the threads; their first releases stand a period after they have all been started.
  // Returns the names of loops that did not get their priority.
  std::vector<std::string> start();
  void stop();                // waits for the threads to end their present cycle
  static TimeNs monotonic();  // CLOCK_MONOTONIC
  TimeNs now() const { return monotonic() - epoch_; }
  const LoopCounters& counters(std::size_t loop) const { return *entries_[loop]->counters; }
  const Loop& loop(std::size_t i) const { return entries_[i]->loop; }
  std::size_t loops() const { return entries_.size(); }

 private:
  struct Entry {
    Loop loop;
    std::unique_ptr<LoopCounters> counters;
    std::thread thread;
  };
  void run(Entry& entry, TimeNs start);  // start: on CLOCK_MONOTONIC
  TimeNs epoch_;
  std::vector<std::unique_ptr<Entry>> entries_;
  std::atomic<bool> stop_{false};
};

}  // namespace wb
