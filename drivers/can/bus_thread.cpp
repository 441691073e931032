#include "drivers/can/bus_thread.hpp"

#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <ctime>
#include <stdexcept>

namespace wb::can {

TimeNs monotonic_ns() noexcept {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec;
}

BusThread::BusThread(const std::string& name, int priority, TimeNs period_ns, TimeNs window_ns,
                     Work work)
    : period_ns_(period_ns), window_ns_(window_ns), work_(std::move(work)) {
  event_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (event_ < 0) throw std::runtime_error("CAN: no eventfd for bus " + name);
  thread_ = std::thread([this] { run(); });
  pthread_setname_np(thread_.native_handle(), ("can_" + name).substr(0, 15).c_str());
  if (priority > 0) {
    sched_param param{};
    param.sched_priority = priority;
    priority_refused_ = pthread_setschedparam(thread_.native_handle(), SCHED_FIFO, &param) != 0;
  }
}

BusThread::~BusThread() {
  ends_ = true;
  wake();
  thread_.join();
  ::close(event_);
}

void BusThread::wake() noexcept {
  const std::uint64_t one = 1;
  (void)!::write(event_, &one, sizeof one);
}

void BusThread::run() {
  TimeNs last = monotonic_ns() - period_ns_, next = last + period_ns_;
  TimeNs collect_at = next;
  TimeNs last_wake = last - 4 * period_ns_;
  bool woken = false;
  while (!ends_) {
    TimeNs now = monotonic_ns();
    const bool by_command = woken && now - last >= period_ns_ / 2;
    if (by_command || now >= next) {
      work_.collect(now);
      now = monotonic_ns();
      work_.cycle(now);
      woken = false;
      last = now;
      collect_at = now + window_ns_;
      // While somebody writes, the cycle waits for the next write a little longer than a period.
      const bool followed = now - last_wake < 2 * period_ns_;
      next = now + (followed ? period_ns_ + period_ns_ / 2 : period_ns_);
    } else if (now >= collect_at) {
      work_.collect(now);
      collect_at = next;
    }
    TimeNs until = std::min(next, collect_at);
    if (woken) until = std::min(until, last + period_ns_ / 2);
    const TimeNs left = std::max<TimeNs>(0, until - monotonic_ns());
    const timespec timeout{left / kNanosPerSecond, left % kNanosPerSecond};
    pollfd wait{event_, POLLIN, 0};
    if (::ppoll(&wait, 1, &timeout, nullptr) > 0) {
      std::uint64_t count;
      (void)!::read(event_, &count, sizeof count);
      woken = true;
      last_wake = monotonic_ns();
    }
  }
}

}  // namespace wb::can
