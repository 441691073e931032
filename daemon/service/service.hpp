// The daemon's DDS edge: checks operators' commands, acknowledges them, publishes what the
// controller shows. World: one ordinary thread of its own does all DDS; real-time threads meet it
// only through the ports' buffers. Wire: ROS 2 without ROS (topics rt/<name>); the daemon's clock
// becomes ROS time here and nowhere else.
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "daemon/service/command_check.hpp"
#include "daemon/service/service_snapshot.hpp"

namespace wb {

struct ServiceOptions {
  int domain = 0;  // see domain_from_environment()
  std::string participant = "wholebodyd";
  CommandRules rules;
  std::vector<std::string> joint_names;   // of q
  std::vector<std::string> finger_names;  // share the gripper's opening equally
  bool truth = false;                     // publish the simulator's ground truth

  // The service's beat, and on which of its beats each stream goes out.
  double rate_hz = 100;
  int state_every = 1;          // rt/joint_states, rt/odom, rt/tf: 100 Hz
  int status_every = 5;         // rt/wholebody/status: 20 Hz
  int plan_every = 10;          // rt/plan: 10 Hz
  int truth_every = 10;         // rt/truth/...: 10 Hz
  int explanation_every = 50;   // rt/wholebody/explanation: 2 Hz, while a request runs
  int diagnostics_every = 100;  // rt/diagnostics: 1 Hz
};

// The service's side of the buffers; all are called from its thread only and must neither block nor
// throw.
struct ServicePorts {
  std::function<TimeNs()> clock;                    // the daemon's, monotonic or virtual
  std::function<bool(const Request&)> submit;       // false: the queue is full
  std::function<bool(RequestStatus&)> take_status;  // false: none is waiting
  std::function<const ServiceSnapshot*()>
      newest;  // null before the first; valid until the next call
  // False: nothing new to explain. May take some milliseconds.
  std::function<bool(DaemonExplanation&)> explain;
};

class Service {
 public:
  // Creates the participant and starts the thread. Throws config::ConfigError.
  Service(ServiceOptions options, ServicePorts ports);
  ~Service();  // stops the thread, within one beat
  Service(const Service&) = delete;
  Service& operator=(const Service&) = delete;

  // Commands seen so far; any thread.
  std::uint64_t accepted() const;
  std::uint64_t refused(Refusal kind) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace wb
