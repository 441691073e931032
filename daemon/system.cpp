#include "daemon/system.hpp"

#include <ctime>

#include "perception/oracle_interpreter.hpp"

namespace wb {
namespace {

DepthFrame frame_prototype(const RobotConfig& robot) {
  DepthFrame f;
  std::size_t pixels = 0;
  for (const CameraConfig& c : robot.cameras) {
    pixels = std::max(pixels, static_cast<std::size_t>(c.intrinsics.width) * c.intrinsics.height);
  }
  f.depth.reserve(pixels);
  f.depth.resize(pixels);
  return f;
}

TimeNs thread_cpu_ns() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return t.tv_sec * kNanosPerSecond + t.tv_nsec;
}

}  // namespace

System::System(const DaemonConfig& config, DriverHost::Log log)
    : config_(config),
      model_(std::make_shared<const RobotModel>(RobotConfig::load(config.robot))),
      host_(model_->config(), config.drivers, std::move(log)),
      truth_(config.interpreter == "oracle"
                 ? std::make_unique<TruthTap>(host_, model_->config().shoulder_camera)
                 : nullptr),
      controller_(model_),
      planner_(model_, config.disabled_terms),
      mapper_(model_),
      perceiver_(model_, make_interpreter()),
      arrows_(mapper_.make_field(), frame_prototype(model_->config())),
      frame_(frame_prototype(model_->config())) {
  const auto& cameras = model_->config().cameras;
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    if (cameras[i].name == model_->config().shoulder_camera) shoulder_camera_ = static_cast<int>(i);
  }
}

std::unique_ptr<SceneInterpreter> System::make_interpreter() {
  if (!truth_) return nullptr;
  OracleOptions options;
  options.seed = config_.seed;
  return std::make_unique<OracleInterpreter>(
      model_, options,
      [this](const Name& object, ObjectTruth& truth) { return truth_->find(object, truth); },
      truth_->spawn_pose());
}

std::set<std::string> System::object_names() const {
  return truth_ ? truth_->object_names() : std::set<std::string>{};
}

void System::advance(TimeNs t) {
  if (host_.can_step()) host_.advance(t);
  if (truth_) truth_->sample(t);
}

std::vector<Loop> System::loops() {
  const auto loop = [](const char* name, const LoopConfig& c, std::function<void(TimeNs)> step,
                       std::function<void()> deliver) {
    return Loop{name, c.rate_hz, c.latency_ns, c.priority, std::move(step), std::move(deliver)};
  };
  return {
      loop("control", config_.control, [this](TimeNs t) { control_step(t); }, {}),
      loop(
          "mpc", config_.mpc, [this](TimeNs t) { mpc_step(t); }, [this] { mpc_deliver(); }),
      loop("frames", config_.frames, [this](TimeNs t) { frames_step(t); }, {}),
      loop(
          "mapping", config_.mapping, [this](TimeNs t) { mapping_step(t); },
          [this] { mapping_deliver(); }),
      loop(
          "perception", config_.perception, [this](TimeNs t) { perception_step(t); },
          [this] { perception_deliver(); }),
  };
}

bool System::submit(Request request) {
  if (tunes(request.kind)) return arrows_.requests_to_mpc.push(request);
  if (request.kind == RequestKind::kOpen && !arrows_.requests_to_perception.push(request))
    return false;
  return arrows_.requests_to_control.push(request);
}

void System::control_step(TimeNs now) {
  if (advance_in_control_) advance(now);
  host_.read(now, readings_);
  ControlRecord& record = control_record_;
  record.t_ns = now;
  record.readings = readings_;
  const Policy* policy = arrows_.policy.read(0);
  const ObjectPlan* plan = arrows_.plan.read();
  record.policy_seq = policy ? policy->seq : 0;
  record.plan_seq = plan ? plan->seq : 0;
  record.request_count = 0;
  while (record.request_count < kMaxRequests &&
         arrows_.requests_to_control.pop(record.requests[record.request_count])) {
    record.requests[record.request_count++].t_ns = now;
  }
  ControlOutput out;
  out.state = &state_;
  out.reference = &reference_;
  controller_.step(
      {now, &record.readings, policy, plan, record.requests.data(), record.request_count}, out);
  // Activation happens while the drives stand still under their brakes; the tick that does it may
  // be late.
  if (out.activate_drives) host_.activate(config_.command_timeout_ns);
  host_.write(out.command);

  arrows_.reference.writing() = reference_;
  arrows_.reference.publish();
  arrows_.state.writing() = state_;
  arrows_.state.publish();
  arrows_.states_to_mapping.push(state_);
  arrows_.states_to_perception.push(state_);
  for (int i = 0; i < out.status_count; ++i) {
    arrows_.statuses.push(out.statuses[i]);
    follow(out.statuses[i]);
  }
  hash_.add(state_);
  hash_.add(out.command);
  record.state_hash = hash_.value();
  if (recording_) arrows_.control_records.push(record);
  fill_snapshot();
}

// Who asked for what: a status carries its request's number only.
void System::follow(const RequestStatus& status) {
  newest_status_ = status;
  if (status.id == opening_.status.id) {
    opening_.status = status;
  } else if (status.outcome == RequestOutcome::kAccepted) {
    for (int i = 0; i < control_record_.request_count; ++i) {
      const Request& r = control_record_.requests[i];
      if (r.id == status.id && r.kind == RequestKind::kOpen) opening_ = {r.object, status};
    }
  }
}

void System::fill_snapshot() {
  ServiceSnapshot& s = arrows_.snapshot.writing();
  s.state = state_;
  s.request = newest_status_;
  s.object = newest_status_.id == opening_.status.id ? opening_.object : Name();
  s.counter_count = 0;
  const auto count = [&](const char* name, std::uint64_t n) {
    s.counters[s.counter_count++] = {Name(name), n};
  };
  const ControlCounters& c = controller_.counters();
  count("driver_faults", c.driver_faults);
  count("invalid_readings", c.invalid_readings);
  count("stale_policies", c.stale_policies);
  count("refused_requests", c.refused_requests);
  count("refused_commands", c.refused_commands);
  count("scaled_commands", c.scaled_commands);
  count("emergency_stops", c.emergency_stops);
  count("degraded_policies", c.degraded_policies);
  count("dropped_frames", arrows_.frames.dropped());
  count("dropped_states", arrows_.states_to_mapping.dropped());
  count("dropped_records", arrows_.control_records.dropped() + arrows_.mpc_records.dropped() +
                               arrows_.mapping_records.dropped());
  arrows_.snapshot.publish();
}

// Between two solves. The service has checked the request against the same table; what does not fit
// it changes nothing.
void System::take_tuning(TimeNs now) {
  Request r;
  while (arrows_.requests_to_mpc.pop(r)) {
    const WeightTable& table = planner_.problem().weights();
    Weights changed = weights_;
    const Weights configured = table.configured();
    const bool known = r.weight >= 0 && r.weight < changed.count;
    if (known) {
      changed.values[r.weight] =
          r.kind == RequestKind::kTune ? r.value : configured.values[r.weight];
    } else if (r.kind == RequestKind::kRevert) {
      changed.values = configured.values;
    }
    RequestStatus status;
    status.id = r.id;
    status.t_ns = now;
    if ((known || r.kind == RequestKind::kRevert) && table.accepts(changed)) {
      ++changed.revision;
      weights_ = mpc_record_.weights = changed;
      tuned_ = true;
      status.outcome = RequestOutcome::kSucceeded;
    } else {
      status.reason = Name("no such weight, or out of range");
    }
    arrows_.mpc_statuses.push(status);
  }
}

void System::mpc_step(TimeNs now) {
  mpc_pending_ = false;
  take_tuning(now);
  const RobotState* state = arrows_.state.read();
  const Reference* reference = arrows_.reference.read();
  if (!state || !reference || !task_runs(state->mode, state->phase)) {
    following_ = false;
    return;
  }
  const DistanceField* field = config_.blind ? nullptr : arrows_.field.read();
  MpcRecord& r = mpc_record_;
  r.t_ns = now;
  r.state_seq = state->seq;
  r.reference_seq = reference->seq;
  r.field_seq = field ? field->seq : 0;
  // The solver takes its own last policy for what moves the robot now; after a rest that is not so.
  r.cold = !following_;
  following_ = true;
  if (r.cold) planner_.reset();
  r.weights = weights_;
  const TimeNs before = thread_cpu_ns();
  (void)planner_.step(*state, *reference, field, arrows_.policy.writing(), r.report, &r.weights);
  r.cpu_ns = thread_cpu_ns() - before;
  r.counters = planner_.counters();
  if (r.report.trouble.kind != TroubleKind::kNone) r.newest_trouble = r.report.trouble;
  arrows_.planned.writing() = planner_.expanded_reference();
  mpc_pending_ = true;
}

void System::mpc_deliver() {
  if (mpc_pending_) {
    mpc_record_.policy_seq = arrows_.policy.publish();
    arrows_.planned.publish();
    if (recording_) arrows_.mpc_records.push(mpc_record_);
  }
  if (!mpc_pending_ && !tuned_) return;
  tuned_ = false;
  arrows_.mpc.writing() = mpc_record_;
  arrows_.mpc.publish();
}

void System::frames_step(TimeNs) {
  while (host_.next_frame(frame_)) {
    if (frame_.camera == shoulder_camera_) continue;  // perception's; nobody reads its pixels yet
    DepthFrame* slot = arrows_.frames.begin_push();
    if (!slot) continue;
    std::swap(*slot, frame_);
    slot->seq = ++frame_seq_;
    if (recording_) {
      if (DepthFrame* copy = arrows_.frame_records.begin_push()) {
        *copy = *slot;
        arrows_.frame_records.end_push();
      }
    }
    arrows_.frames.end_push();
  }
}

void System::mapping_step(TimeNs now) {
  MappingRecord& r = mapping_record_;
  r.t_ns = now;
  r.state_count = r.frame_count = 0;
  while (const RobotState* s = arrows_.states_to_mapping.peek()) {
    if (r.state_count++ == 0) r.first_state_seq = s->seq;
    mapper_.push_state(*s);
    arrows_.states_to_mapping.pop();
  }
  const DepthFrame* frames[MappingRecord::kMaxFrames];
  while (r.frame_count < MappingRecord::kMaxFrames) {
    const DepthFrame* f = arrows_.frames.peek(r.frame_count);
    if (!f) break;
    r.frame_seqs[r.frame_count] = f->seq;
    frames[r.frame_count++] = f;
  }
  r.report =
      mapper_.update({frames, static_cast<std::size_t>(r.frame_count)}, arrows_.field.writing());
  for (int i = 0; i < r.frame_count; ++i) arrows_.frames.pop();
}

void System::mapping_deliver() {
  mapping_record_.field_seq = arrows_.field.publish();
  if (recording_) arrows_.mapping_records.push(mapping_record_);
}

void System::perception_step(TimeNs) {
  Request request;
  while (arrows_.requests_to_perception.pop(request)) perceiver_.look_for(request.object);
  while (arrows_.states_to_perception.pop(perceived_state_)) have_perceived_state_ = true;
  plan_pending_ =
      have_perceived_state_ && perceiver_.step(perceived_state_, arrows_.plan.writing());
}

void System::perception_deliver() {
  if (!plan_pending_) return;
  const ObjectPlan& plan = arrows_.plan.writing();
  arrows_.plan.publish();
  if (recording_) arrows_.plan_records.push(plan);
}

}  // namespace wb
