#include "daemon/serving.hpp"

namespace wb {

Serving::Serving(System& system, bool truth, std::function<TimeNs()> clock,
                 std::function<void(ServiceSnapshot&)> add_loops)
    : system_(system), truth_(truth), add_loops_(std::move(add_loops)) {
  if (truth && !system.truth()) {
    throw config::ConfigError("--truth needs a simulated plant and interpreter: oracle");
  }
  driver_counts_.resize(system.host().counter_names().size());
  if (driver_counts_.size() > ServiceSnapshot::kMaxDriverCounters) {
    throw config::ConfigError("the drivers have " + std::to_string(driver_counts_.size()) +
                              " counters, the status shows at most " +
                              std::to_string(ServiceSnapshot::kMaxDriverCounters));
  }
  ServiceOptions options;
  options.domain = domain_from_environment();
  const RobotModel& model = system.model();
  for (const JointConfig& j : model.config().joints) options.joint_names.push_back(j.name);
  options.finger_names = model.config().fingers;
  for (int i = 0; i < model.joints(); ++i) options.rules.joints.push_back(model.limits(i));
  options.rules.mobile_base = model.base_dof() > 0;
  options.rules.objects = system.object_names();
  options.truth = truth;
  ServicePorts ports;
  ports.clock = std::move(clock);
  ports.submit = [this](const Request& r) {
    const bool accepted = system_.submit(r);
    if (accepted) started_ = true;
    return accepted;
  };
  ports.take_status = [this](RequestStatus& s) { return system_.arrows().statuses.pop(s); };
  ports.newest = [this] { return newest(); };
  service_ = std::make_unique<Service>(std::move(options), std::move(ports));
}

const ServiceSnapshot* Serving::newest() {
  const ServiceSnapshot* s = system_.arrows().snapshot.read();
  if (!s) return nullptr;
  shown_ = *s;
  show_plan();
  show_driver_counters();
  add_loops_(shown_);
  if (truth_) system_.truth()->show(shown_);
  return &shown_;
}

void Serving::show_driver_counters() {
  const DriverHost& host = system_.host();
  host.read_counters(driver_counts_.data());
  for (std::size_t i = 0; i < driver_counts_.size(); ++i)
    shown_.counters[shown_.counter_count++] = {Name(host.counter_names()[i]), driver_counts_[i]};
}

void Serving::show_plan() {
  const Policy* policy = system_.arrows().policy.read(1);
  shown_.plan_count = 0;
  if (!policy || shown_.state.mode != Mode::kActive) return;  // an old plan is nobody's any more
  const RobotModel& model = system_.model();
  RobotModel::Data data;
  for (int i = 0; i < policy->nodes; ++i) {
    model.forward_kinematics(policy->x(i).data(), data);
    shown_.plan_t_ns[i] = policy->t[i];
    shown_.plan[i] = Pose::from(model.X_WF(model.end_effector(), data));
  }
  shown_.plan_count = policy->nodes;
}

}  // namespace wb
