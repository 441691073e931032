// The plugin's thread: an exchange with the gripper every 10 ms. Ports meet it only through the two
// buffers and the atomics. Constructor, destructor: setup world. request(), expired(), newest():
// ports, one thread (control).
#pragma once
#include <atomic>
#include <optional>
#include <string>
#include <thread>

#include "core/rt/latest.hpp"
#include "drivers/robotiq/link.hpp"
#include "drivers/robotiq/operation.hpp"

namespace wb::robotiq {

struct Report {
  std::uint64_t seq = 0;
  TimeNs t_ns = 0;  // when the answer came, CLOCK_MONOTONIC
  Status status;
  double force_n = 0;  // what the gripper was told to press with while it touches something, else 0
  std::uint32_t lost = 0;  // the activation that the gripper has lost or ended by a fault; 0: none
};

struct Counters {
  std::atomic<std::uint64_t> exchanges{0}, time_outs{0}, checksum_errors{0}, other_errors{0},
      closed{0};
};

class Worker {
 public:
  explicit Worker(const Config& config);
  ~Worker();

  void request(const Request& request) RT_SAFE;
  // Whether this activation's commands have ceased for longer than its time-out; latched.
  bool expired(std::uint32_t activation) const RT_SAFE {
    return expired_.load(std::memory_order_acquire) == activation;
  }
  void expire(std::uint32_t activation) RT_SAFE {
    expired_.store(activation, std::memory_order_release);
  }
  const Report* newest() RT_SAFE { return reports_.read(); }  // null before the first answer
  const Counters& counters() const { return counters_; }
  LinkResult last_result() const { return last_result_.load(); }

 private:
  void run();
  void cycle();
  void count(LinkResult result);

  Link link_;
  Operation operation_;
  Latest<Request> requests_;
  Latest<Report> reports_;
  Counters counters_;
  std::atomic<LinkResult> last_result_{LinkResult::kClosed};
  std::atomic<std::uint32_t> expired_{0};
  std::atomic<bool> stopping_{false};
  // The thread's own.
  Status status_;
  bool answered_ = false;         // status_ is of the last exchange
  std::optional<Order> written_;  // what stands in the gripper's registers, if that is known
  std::thread thread_;
};

}  // namespace wb::robotiq
