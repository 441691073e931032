// Joins the DDS service to the system's arrows. Ordinary threads.
#pragma once
#include <atomic>
#include <functional>
#include <memory>
#include <mutex>

#include "daemon/service/service.hpp"
#include "daemon/system.hpp"

namespace wb {

class Serving {
 public:
  // Starts the service. virtual_clock: the time is what set_time() says.
  Serving(System& system, bool truth);

  bool started() const { return started_; }                     // a request has been accepted
  void set_time(TimeNs t) { virtual_now_ = t; }                 // Lockstep
  void use_clock(std::function<TimeNs()> clock);                // RealTime
  void show_counters(std::function<void(ServiceSnapshot&)> add);

 private:
  const ServiceSnapshot* newest();

  System& system_;
  std::mutex mutex_;                                            // guards the two functions; service thread and main only
  std::function<TimeNs()> clock_;
  std::function<void(ServiceSnapshot&)> add_;
  ServiceSnapshot shown_;
  std::atomic<bool> started_{false};
  std::atomic<TimeNs> virtual_now_{0};
  std::unique_ptr<Service> service_;
};

}  // namespace wb
