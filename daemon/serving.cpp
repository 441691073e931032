#include "daemon/serving.hpp"

namespace wb {

Serving::Serving(System& system, bool truth) : system_(system) {
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
  ports.clock = [this] {
    const std::lock_guard lock(mutex_);
    return clock_ ? clock_() : virtual_now_.load();
  };
  ports.submit = [this](const Request& r) {
    const bool accepted = system_.submit(r);
    if (accepted) started_ = true;
    return accepted;
  };
  ports.take_status = [this](RequestStatus& s) { return system_.arrows().statuses.pop(s); };
  ports.newest = [this] { return newest(); };
  service_ = std::make_unique<Service>(std::move(options), std::move(ports));
}

void Serving::use_clock(std::function<TimeNs()> clock) {
  const std::lock_guard lock(mutex_);
  clock_ = std::move(clock);
}

void Serving::show_counters(std::function<void(ServiceSnapshot&)> add) {
  const std::lock_guard lock(mutex_);
  add_ = std::move(add);
}

const ServiceSnapshot* Serving::newest() {
  const ServiceSnapshot* s = system_.arrows().snapshot.read();
  if (!s) return nullptr;
  shown_ = *s;
  const std::lock_guard lock(mutex_);
  if (add_) add_(shown_);
  return &shown_;
}

}  // namespace wb
