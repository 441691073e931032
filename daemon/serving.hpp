// Joins the DDS service to the system's arrows, and adds what only this edge needs: the plan as
// hand poses, explanations, loops, counters, truth. Ordinary threads: the service's, except where
// noted.
#pragma once
#include <atomic>
#include <functional>
#include <memory>

#include "daemon/service/service.hpp"
#include "daemon/system.hpp"

namespace wb {

class Serving {
 public:
  // Starts the service. `clock` is the daemon's time and must tell it from now on: the offset to
  // ROS time is taken here. `add_loops` adds the executor's counters to a snapshot. The service's
  // thread calls both until this object is gone. Throws config::ConfigError.
  Serving(System& system, bool truth, std::function<TimeNs()> clock,
          std::function<void(ServiceSnapshot&)> add_loops);

  bool started() const { return started_; }  // a request has been accepted; any thread

 private:
  const ServiceSnapshot* newest();
  void show_plan();  // hand poses over the newest policy's horizon
  void show_mpc();
  void show_driver_counters();
  bool explain(DaemonExplanation& out);  // of the newest policy; job, some milliseconds

  System& system_;
  const bool truth_;
  const std::function<void(ServiceSnapshot&)> add_loops_;
  ServiceSnapshot shown_;
  std::vector<std::uint64_t> driver_counts_;
  std::uint64_t explained_ = 0;  // Policy::seq
  std::atomic<bool> started_{false};
  std::unique_ptr<Service> service_;  // last: its thread uses all of the above
};

}  // namespace wb
