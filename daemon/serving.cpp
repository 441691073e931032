#include "daemon/serving.hpp"

#include "mpc/explanation.hpp"

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
  const OptimalControlProblem& problem = system.problem();
  options.rules.weights = problem.weights().infos();
  for (const auto& term : problem.terms()) options.rules.terms.insert(term->name());
  options.truth = truth;
  ServicePorts ports;
  ports.clock = std::move(clock);
  ports.submit = [this](const Request& r) {
    const bool accepted = system_.submit(r);
    if (accepted) started_ = true;
    return accepted;
  };
  ports.take_status = [this](RequestStatus& s) {
    return system_.arrows().statuses.pop(s) || system_.arrows().mpc_statuses.pop(s);
  };
  ports.newest = [this] { return newest(); };
  ports.explain = [this](DaemonExplanation& e) { return explain(e); };
  service_ = std::make_unique<Service>(std::move(options), std::move(ports));
}

const ServiceSnapshot* Serving::newest() {
  const ServiceSnapshot* s = system_.arrows().snapshot.read();
  if (!s) return nullptr;
  shown_ = *s;
  show_plan();
  show_mpc();
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

void Serving::show_mpc() {
  const MpcRecord* r = system_.arrows().mpc.read();
  const MpcRecord none;
  const SolverCounters& c = (r ? *r : none).counters;
  const auto count = [&](const char* name, std::uint64_t n) {
    shown_.counters[shown_.counter_count++] = {Name(name), n};
  };
  count("mpc_solves", c.solves);
  count("mpc_no_step", c.no_step);
  count("mpc_shortened", c.shortened);
  count("mpc_kept", c.kept);
  count("mpc_regularised", c.regularised);
  count("mpc_refused_weights", c.refused_weights);
  const std::string trouble = describe(system_.problem(), (r ? *r : none).newest_trouble);
  shown_.mpc_trouble.fill(0);
  std::copy_n(trouble.begin(), std::min(trouble.size(), shown_.mpc_trouble.size() - 1),
              shown_.mpc_trouble.begin());
  if (r) shown_.weights = r->weights;
}

bool Serving::explain(DaemonExplanation& out) {
  Arrows& arrows = system_.arrows();
  const Policy* policy = arrows.policy.read(1);
  const Reference* reference = arrows.planned.read();
  const MpcRecord* record = arrows.mpc.read();
  if (!policy || !reference || !record || policy->seq == explained_ ||
      !task_runs(shown_.state.mode, shown_.state.phase)) {
    return false;
  }
  explained_ = policy->seq;
  const OptimalControlProblem& problem = system_.problem();
  const DistanceField* field = system_.config().blind ? nullptr : arrows.field.read(1);
  const Explanation e = wb::explain(problem, *reference, field, record->weights, *policy);
  out = {};
  out.stamp_ns = policy->t_ns;
  out.status = to_string(record->report.status);
  out.trouble = describe(problem, record->report.trouble);
  out.step = record->report.step;
  out.cpu_ms = 1e-6 * static_cast<double>(record->cpu_ns);
  out.cost = e.cost;
  out.weights_revision = record->report.weights_revision;
  for (const TermPull& t : e.terms)
    out.terms.push_back({t.name, t.cost, t.share, t.violation, t.pull});
  for (const Competition& c : e.competing) {
    out.competing.push_back({e.terms[c.first].name, e.terms[c.second].name, c.cosine, c.text});
  }
  return true;
}

void Serving::show_plan() {
  const Policy* policy = system_.arrows().policy.read(1);
  shown_.plan_count = 0;
  if (!policy || !task_runs(shown_.state.mode, shown_.state.phase))
    return;  // an old plan is nobody's any more
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
