// Keeps a virtual clock from running ahead of the wall clock. Ordinary thread.
#pragma once
#include <ctime>

#include "core/rt/executor.hpp"

namespace wb {

inline void sleep_ns(TimeNs ns) {
  const timespec t{ns / kNanosPerSecond, ns % kNanosPerSecond};
  nanosleep(&t, nullptr);
}

class Pacer {
 public:
  void restart(TimeNs virtual_now) { offset_ = RealTime::monotonic() - virtual_now; }
  // Sleeps until the wall clock has reached `virtual_now`; a slow machine just runs late.
  void wait(TimeNs virtual_now) {
    const TimeNs ahead = virtual_now + offset_ - RealTime::monotonic();
    if (ahead > 1'000'000) sleep_ns(ahead);
  }

 private:
  TimeNs offset_ = 0;
};

}  // namespace wb
