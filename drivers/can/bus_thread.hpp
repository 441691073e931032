// BusThread: runs one bus in real time on a thread of its own. It sleeps on an event and a timer,
// not on the bus: a cycle begins when the control thread has written (SYNC is the control tick), or
// by itself after a period without; what was answered is collected at the end of the answers'
// window. Absolute times on CLOCK_MONOTONIC, ppoll with a high-resolution timer; a cycle that comes
// late is skipped, never made up for.
#pragma once
#include <atomic>
#include <functional>
#include <string>
#include <thread>

#include "core/types/time.hpp"

namespace wb::can {

class BusThread {
 public:
  struct Work {
    std::function<void(TimeNs)> cycle;    // judge, send
    std::function<void(TimeNs)> collect;  // take answers, publish readings
  };
  // Setup; `refused` says whether the priority was. window_ns: from a cycle to its collect.
  BusThread(const std::string& name, int priority, TimeNs period_ns, TimeNs window_ns, Work work);
  ~BusThread();  // ends after the present cycle
  BusThread(const BusThread&) = delete;
  BusThread& operator=(const BusThread&) = delete;

  void wake() noexcept;  // a command was written; non-blocking
  bool priority_refused() const { return priority_refused_; }

 private:
  void run();
  TimeNs period_ns_, window_ns_;
  Work work_;
  int event_ = -1;
  std::atomic<bool> ends_{false};
  bool priority_refused_ = false;
  std::thread thread_;
};

}  // namespace wb::can
