#include "drivers/robotiq/worker.hpp"

#include <ctime>

#include "core/rt/executor.hpp"

namespace wb::robotiq {
namespace {

// The manual asks for at least 5 ms between orders; an exchange takes about 3 ms on the wire.
constexpr TimeNs kPeriodNs = 10'000'000;
constexpr TimeNs kReopenNs = 200'000'000;  // between attempts at a port that is not there

void sleep_until(TimeNs t) {
  const timespec at{t / kNanosPerSecond, t % kNanosPerSecond};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
}

}  // namespace

Worker::Worker(const Config& config) : link_(config), operation_(config.speed) {
  thread_ = std::thread([this] { run(); });
}

Worker::~Worker() {
  stopping_ = true;
  thread_.join();
}

void Worker::request(const Request& request) RT_SAFE {
  requests_.writing() = request;
  requests_.publish();
}

void Worker::run() {
  TimeNs next = RealTime::monotonic();
  while (!stopping_) {
    cycle();
    const TimeNs now = RealTime::monotonic();
    next = std::max(next + kPeriodNs, now + kPeriodNs / 2);
    if (last_result_ == LinkResult::kClosed) next = now + kReopenNs;
    sleep_until(next);
  }
}

void Worker::cycle() {
  const Request* request = requests_.read();
  Order order;
  bool send = false;
  if (request != nullptr && request->activation != 0) {
    if (request->overdue(RealTime::monotonic())) expire(request->activation);
    // Nothing is said before the gripper has told where it stands, nor said twice: one that comes
    // back from a loss of power would take a repeated order for the wish to be activated, and open.
    if (answered_) {
      send = operation_.next(*request, request->hold || expired(request->activation), status_,
                             order) &&
             written_ != order;
    }
  }
  const LinkResult result = link_.exchange(send ? &order : nullptr, status_);
  count(result);
  answered_ = result == LinkResult::kOk;
  if (!answered_) {
    written_.reset();
    return;
  }
  if (send) written_ = order;
  Report& report = reports_.writing();
  report.t_ns = RealTime::monotonic();
  report.status = status_;
  report.force_n = status_.touches() ? operation_.force_n() : 0;
  report.lost = operation_.stage() == Operation::Stage::kLost ? operation_.activation() : 0;
  reports_.publish();
}

void Worker::count(LinkResult result) {
  const auto add = [](std::atomic<std::uint64_t>& n) { n.fetch_add(1, std::memory_order_relaxed); };
  add(counters_.exchanges);
  switch (result) {
    case LinkResult::kOk:
      break;
    case LinkResult::kTimedOut:
      add(counters_.time_outs);
      break;
    case LinkResult::kBadChecksum:
      add(counters_.checksum_errors);
      break;
    case LinkResult::kOtherError:
      add(counters_.other_errors);
      break;
    case LinkResult::kClosed:
      // Once for each loss, not for each attempt to open the port again.
      if (last_result_ != LinkResult::kClosed) add(counters_.closed);
      break;
  }
  last_result_ = result;
}

}  // namespace wb::robotiq
