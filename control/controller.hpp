// The whole control step, 400 Hz: Estimator > modes > TaskSequencer > policy > WholeBodyController
// > CommandGate. Step world: a result depends on the controller's state and on ControlInput alone.
// Frames W, B, E; SI.
#pragma once
#include <memory>

#include "control/command_gate.hpp"
#include "control/estimator.hpp"
#include "control/task_sequencer.hpp"
#include "control/whole_body_controller.hpp"
#include "core/types/request.hpp"

namespace wb {

struct ControlInput {
  TimeNs t_ns = 0;
  const Readings* readings = nullptr;
  const Policy* policy = nullptr;    // newest, or null
  const ObjectPlan* plan = nullptr;  // newest, or null
  const Request* requests = nullptr;
  int request_count = 0;
};

struct ControlOutput {
  RobotState* state = nullptr;     // filled
  Reference* reference = nullptr;  // filled
  SafeCommand command;
  bool activate_drives = false;  // activate them after this tick (again, if they are): a reset
  bool hand_empty = true;
  int status_count = 0;  // requests whose outcome changed
  std::array<RequestStatus, kMaxRequests + 2> statuses{};
};

// Counters since start; each fault has one.
struct ControlCounters {
  std::uint64_t driver_faults = 0, invalid_readings = 0, stale_policies = 0, refused_requests = 0,
                refused_commands = 0, scaled_commands = 0, emergency_stops = 0,
                degraded_policies = 0;  // not of full quality, while a task ran
};

class Controller {
 public:
  // Reads robot_folder/control.yaml. Throws config::ConfigError.
  explicit Controller(std::shared_ptr<const RobotModel> model);

  void step(const ControlInput& in, ControlOutput& out) RT_SAFE;
  const ControlCounters& counters() const { return counters_; }

 private:
  void handle(const Request& request, const Readings& readings, ControlOutput& out) RT_SAFE;
  bool joints_measured(const Readings& readings) const RT_SAFE;  // wheels among them
  void watch(const ControlInput& in) RT_SAFE;  // enters DEGRADED, HOLD or SETTLE on trouble
  void end_task() RT_SAFE;
  void watch_quality(const Policy* policy) RT_SAFE;
  bool task_running() const RT_SAFE { return task_runs(mode_, task_.phase); }
  double speed() const RT_SAFE;  // of the task
  // Carries the task on and hands over its Reference, at half speed in DEGRADED.
  void carry_on(const ControlInput& in, double dt_s) RT_SAFE;
  void report(ControlOutput& out, std::uint64_t id, RequestOutcome outcome,
              std::string_view reason) RT_SAFE;

  std::shared_ptr<const RobotModel> model_;
  config::Section section_;
  Estimator estimator_;
  TaskSequencer sequencer_;
  WholeBodyController wbc_;
  CommandGate gate_;
  TimeNs policy_memory_ns_, degraded_memory_ns_, reading_memory_ns_;
  double status_rate_hz_;

  Mode mode_ = Mode::kIdle;
  RobotState state_;
  Reference reference_;
  TaskOutput task_;
  Name trouble_;
  Request running_;
  TimeNs running_since_ = 0;
  // The task's own clock: the daemon's, but half as fast in DEGRADED, so that nothing of the task
  // jumps when it slows down.
  TimeNs task_t_ = 0;
  TimeNs policy_t_ = 0;       // of the policy that was judged last
  TimeNs full_policy_t_ = 0;  // of the last one of full quality; before the first, the task's start
  int bad_policies_ = 0;      // in a row
  TimeNs last_t_ = 0;
  TimeNs last_status_ = 0;
  bool reset_ = false;  // in this tick: faults of before do not count against it
  ControlCounters counters_;
};

}  // namespace wb
