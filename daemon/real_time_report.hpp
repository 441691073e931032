// What a run cost and how punctual it was: CPU time, wake-up lateness, overruns, and the host's
// steal time beside them, since lateness under steal says nothing about the program. Setup world.
#pragma once
#include <cstdio>

#include "core/rt/executor.hpp"
#include "daemon/service/service_snapshot.hpp"
#include "daemon/steal.hpp"

namespace wb {

// Shows the loops of either executor in the service's snapshot.
template <class Executor>
void add_loops(const Executor& executor, ServiceSnapshot& s) {
  s.loop_count = 0;
  for (std::size_t i = 0; i < executor.loops() && s.loop_count < ServiceSnapshot::kMaxLoops; ++i) {
    const LoopCounters& c = executor.counters(i);
    LoopStatistics& l = s.loops[s.loop_count++];
    l.name = Name(executor.loop(i).name);
    l.cycles = c.cycles.load();
    l.overruns = c.overruns.load();
    l.p50_us = c.cpu.quantile_us(0.5);
    l.p99_us = c.cpu.quantile_us(0.99);
    l.max_us = c.cpu.max_us();
  }
}

class RealTimeReport {
 public:
  RealTimeReport() : steal_(steal_ticks()) {}

  void print(const RealTime& executor) const {
    std::fprintf(stderr, "%-12s %8s %8s %11s %11s %11s %12s %12s\n", "loop", "cycles", "skipped",
                 "cpu p50 us", "cpu p99 us", "cpu max us", "late p99 us", "late max us");
    for (std::size_t i = 0; i < executor.loops(); ++i) {
      const LoopCounters& c = executor.counters(i);
      std::fprintf(stderr, "%-12s %8lu %8lu %11.0f %11.0f %11.0f %12.0f %12.0f\n",
                   executor.loop(i).name.c_str(), c.cycles.load(), c.overruns.load(),
                   c.cpu.quantile_us(0.5), c.cpu.quantile_us(0.99), c.cpu.max_us(),
                   c.late.quantile_us(0.99), c.late.max_us());
    }
    std::fprintf(stderr, "steal: %ld ticks of 10 ms\n", steal_ticks() - steal_);
  }

 private:
  long steal_;
};

}  // namespace wb
