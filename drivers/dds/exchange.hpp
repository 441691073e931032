// Everything that the ports (control thread) and the DDS thread have in common: buffers, flags and
// two doorbells. The ports only touch this, so they never call DDS, lock or allocate. Times on the
// host's clock unless named stamps.
#pragma once
#include <poll.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

#include <atomic>
#include <stdexcept>

#include "core/rt/latest.hpp"
#include "drivers/dds/samples.hpp"

namespace wb::dds {

// Wakes one thread from any other, without blocking.
class Doorbell {
 public:
  Doorbell() : fd_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    if (fd_ < 0) throw std::runtime_error("eventfd failed");
  }
  ~Doorbell() { close(fd_); }
  Doorbell(const Doorbell&) = delete;
  Doorbell& operator=(const Doorbell&) = delete;
  void ring() noexcept {
    const std::uint64_t one = 1;
    (void)!::write(fd_, &one, sizeof one);
  }
  // Until it rings (also before the call), at most timeout_ns.
  void wait(TimeNs timeout_ns) noexcept {
    const timespec t{timeout_ns / kNanosPerSecond, timeout_ns % kNanosPerSecond};
    pollfd p{fd_, POLLIN, 0};
    if (timeout_ns <= 0 || ppoll(&p, 1, &t, nullptr) <= 0) return;
    std::uint64_t count = 0;
    (void)!::read(fd_, &count, sizeof count);
  }

 private:
  int fd_;
};

inline TimeNs clock_ns(clockid_t clock) noexcept {
  timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec * kNanosPerSecond + t.tv_nsec;
}

// What write() hands over.
struct Order {
  std::uint64_t seq = 0;  // Latest's
  std::uint64_t activation = 0;
  wb_commands commands{};
};

struct Exchange {
  explicit Exchange(bool is_paced) : paced(is_paced) {}

  const bool paced;
  // DDS thread -> control
  Latest<Sample> measurements;
  Latest<ImuSample> imu;
  Latest<WrenchSample> wrench;
  std::atomic<std::uint64_t> tick_done{0};
  // control -> DDS thread
  Latest<Order> orders;
  std::atomic<TimeNs> tick_t_ns{0};
  std::atomic<std::uint64_t> tick_asked{0};
  // both
  std::atomic<std::uint64_t> activation{0};  // number of the present one, 0: inactive
  std::atomic<bool> latched{false};          // stopped until the next activation
  std::atomic<TimeNs> timeout_ns{0};
  std::atomic<TimeNs> last_write_ns{-1};  // -1: none in this activation
  Doorbell to_thread, to_control;

  // The host's clock, on which samples' times are handed to the daemon.
  TimeNs now() const noexcept {
    return paced ? tick_t_ns.load(std::memory_order_relaxed) : clock_ns(CLOCK_MONOTONIC);
  }
  // The stamps' clock less the host's. Real time: taken anew each time, since ROS time is steered.
  TimeNs stamp_offset() const noexcept {
    return paced ? 0 : clock_ns(CLOCK_REALTIME) - clock_ns(CLOCK_MONOTONIC);
  }
  // The plugin's side of the command time-out. Either thread.
  void watch() noexcept {
    const TimeNs last = last_write_ns.load(std::memory_order_acquire);
    if (activation.load(std::memory_order_relaxed) == 0 || last < 0) return;
    if (now() - last > timeout_ns.load(std::memory_order_relaxed))
      latched.store(true, std::memory_order_release);
  }
};

}  // namespace wb::dds
