#include "core/rt/executor.hpp"

#include <pthread.h>
#include <sched.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <stdexcept>

namespace wb {
namespace {

TimeNs read_clock(clockid_t id) {
  timespec t;
  clock_gettime(id, &t);
  return static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec;
}

// Runs one function of a loop and books its thread CPU time.
template <class F>
TimeNs timed(LoopCounters& s, F&& f) {
  const TimeNs before = read_clock(CLOCK_THREAD_CPUTIME_ID);
  f();
  const TimeNs spent = read_clock(CLOCK_THREAD_CPUTIME_ID) - before;
  s.cpu_ns.fetch_add(spent, std::memory_order_relaxed);
  return spent;
}

// Until the first releases are counted from: long enough for every thread to be there with its
// priority.
constexpr TimeNs kGather_ns = 20'000'000;

}  // namespace

TimeNs release_time(std::uint64_t k, double rate_hz) {
  return static_cast<TimeNs>(
      std::ceil(static_cast<long double>(k) * 1e9L / static_cast<long double>(rate_hz)));
}

Lockstep::Lockstep(std::function<void(TimeNs)> advance_plant)
    : advance_plant_(std::move(advance_plant)) {}

void Lockstep::add(Loop loop) {
  if (!(loop.rate_hz > 0)) throw std::invalid_argument("loop '" + loop.name + "' needs a rate");
  entries_.push_back({std::move(loop), 0, 0, kNever, std::make_unique<LoopCounters>()});
}

TimeNs Lockstep::run_next() {
  TimeNs next = kNever;
  for (const Entry& e : entries_) next = std::min({next, e.release, e.due});
  now_ = next;
  if (advance_plant_) advance_plant_(now_);
  for (Entry& e : entries_) {
    if (e.due != now_) continue;
    if (e.loop.deliver) timed(*e.counters, e.loop.deliver);
    e.due = kNever;
  }
  for (Entry& e : entries_) {
    if (e.release != now_) continue;
    e.release = release_time(++e.k, e.loop.rate_hz);
    if (e.due != kNever) {  // its last result is still on the way: a real thread would be busy, too
      e.counters->overruns.fetch_add(1, std::memory_order_relaxed);
      continue;
    }
    e.counters->cycles.fetch_add(1, std::memory_order_relaxed);
    e.counters->cpu.add(timed(*e.counters, [&] { e.loop.step(now_); }));
    if (e.loop.latency_ns > 0) {
      e.due = now_ + e.loop.latency_ns;
    } else if (e.loop.deliver) {
      timed(*e.counters, e.loop.deliver);
    }
  }
  return now_;
}

RealTime::~RealTime() { stop(); }

TimeNs RealTime::monotonic() { return read_clock(CLOCK_MONOTONIC); }

void RealTime::add(Loop loop) {
  if (!(loop.rate_hz > 0)) throw std::invalid_argument("loop '" + loop.name + "' needs a rate");
  entries_.push_back(
      std::make_unique<Entry>(Entry{std::move(loop), std::make_unique<LoopCounters>(), {}}));
}

std::vector<std::string> RealTime::start() {
  stop_ = false;
  const TimeNs start = monotonic() + kGather_ns;
  std::vector<std::string> refused;
  for (auto& e : entries_) {
    e->thread = std::thread([this, entry = e.get(), start] { run(*entry, start); });
    pthread_setname_np(e->thread.native_handle(), e->loop.name.substr(0, 15).c_str());
    if (e->loop.priority > 0) {
      sched_param param{};
      param.sched_priority = e->loop.priority;
      if (pthread_setschedparam(e->thread.native_handle(), SCHED_FIFO, &param) != 0)
        refused.push_back(e->loop.name);
    }
  }
  return refused;
}

void RealTime::run(Entry& e, TimeNs start) {
  std::uint64_t k = 1;
  while (!stop_.load(std::memory_order_relaxed)) {
    const TimeNs release = start + release_time(k, e.loop.rate_hz);
    const timespec wake{release / kNanosPerSecond, release % kNanosPerSecond};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr) == EINTR) {
    }
    if (stop_.load(std::memory_order_relaxed)) break;
    const TimeNs woken = monotonic();
    LoopCounters& s = *e.counters;
    s.late.add(woken - release);
    s.cycles.fetch_add(1, std::memory_order_relaxed);
    s.cpu.add(timed(s, [&] {
      e.loop.step(woken - epoch_);
      if (e.loop.deliver) e.loop.deliver();
    }));
    // The next release still ahead of us; those that passed meanwhile are skipped and counted,
    // never run in a burst.
    const TimeNs done = monotonic();
    std::uint64_t skipped = 0;
    for (++k; start + release_time(k, e.loop.rate_hz) <= done; ++k) ++skipped;
    if (skipped) s.overruns.fetch_add(skipped, std::memory_order_relaxed);
  }
}

void RealTime::stop() {
  stop_ = true;
  for (auto& e : entries_) {
    if (e->thread.joinable()) e->thread.join();
  }
}

}  // namespace wb
