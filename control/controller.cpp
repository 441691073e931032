#include "control/controller.hpp"

#include <algorithm>
#include <cmath>

namespace wb {
namespace {

// DEGRADED: entered after so many policies in a row that are not of full quality (one alone may be
// a single bad frame), and how fast the task then goes on.
constexpr int kBadPolicies = 2;
constexpr double kDegradedSpeed = 0.5;

}  // namespace

Controller::Controller(std::shared_ptr<const RobotModel> model)
    : model_(std::move(model)),
      section_(config::Section::open(model_->config().folder / "control.yaml")),
      estimator_(model_, section_.section("estimator")),
      sequencer_(model_, section_.section("sequencer")),
      wbc_(model_, section_.section("whole_body")),
      gate_(model_),
      policy_memory_ns_(from_seconds(section_.number("policy_memory_s", config::kPositive))),
      degraded_memory_ns_(from_seconds(section_.number("degraded_memory_s", config::kPositive))),
      reading_memory_ns_(from_seconds(section_.number("reading_memory_s", config::kPositive))),
      status_rate_hz_(section_.number("status_rate_hz", config::kPositive)) {
  section_.finish();
}

void Controller::report(ControlOutput& out, std::uint64_t id, RequestOutcome outcome,
                        std::string_view reason) RT_SAFE {
  if (out.status_count >= static_cast<int>(out.statuses.size())) return;
  RequestStatus& s = out.statuses[out.status_count++];
  s = RequestStatus{
      id, outcome, task_.phase, state_.t_ns, task_.joint_value, task_.joint_range, Name(reason)};
}

bool Controller::joints_measured(const Readings& r) const RT_SAFE {
  if (r.joint_count != model_->joints()) return false;
  const auto good = [&](const JointReading& j) {
    return j.valid && j.age_ns <= reading_memory_ns_ && std::isfinite(j.position) &&
           std::isfinite(j.velocity) && std::isfinite(j.torque);
  };
  return std::all_of(r.joints.begin(), r.joints.begin() + r.joint_count, good) &&
         std::all_of(r.wheels.begin(), r.wheels.begin() + r.wheel_count, good);
}

void Controller::handle(const Request& r, const Readings& readings, ControlOutput& out) RT_SAFE {
  const auto refuse = [&](std::string_view why) {
    ++counters_.refused_requests;
    report(out, r.id, RequestOutcome::kRefused, why);
  };
  switch (r.kind) {
    case RequestKind::kStop:
      if (task_running()) {
        report(out, running_.id, RequestOutcome::kFailed, "stopped");
        end_task();
      }
      report(out, r.id, RequestOutcome::kSucceeded, "");
      return;
    case RequestKind::kReset:
      if (task_running()) return refuse("busy: stop first");
      if (readings.emergency_stop) return refuse("emergency stop pressed");
      if (!joints_measured(readings)) return refuse("joint readings missing");
      // From here the set-points start at the measured posture, so that activating moves nothing.
      gate_.reset(state_.q.data());
      sequencer_.abort();
      mode_ = Mode::kReady;
      trouble_ = Name();
      reset_ = true;
      report(out, r.id, RequestOutcome::kSucceeded, "");
      return;
    case RequestKind::kOpen:
    case RequestKind::kMoveJoints:
    case RequestKind::kMoveBase:
      if (task_running()) return refuse("busy");
      if (mode_ != Mode::kReady) return refuse("not ready: reset first");
      if (r.kind == RequestKind::kMoveBase && model_->base_dof() == 0)
        return refuse("the base is fixed");
      if (r.kind == RequestKind::kOpen && model_->config().fingers.empty())
        return refuse("no gripper");
      if (r.kind == RequestKind::kMoveJoints) {
        if (r.joint_count != model_->joints()) return refuse("wrong number of joints");
        for (int i = 0; i < model_->joints(); ++i) {
          if (!(r.q[i] >= model_->limits(i).lower && r.q[i] <= model_->limits(i).upper))
            return refuse("out of joint range");
        }
      }
      running_ = r;
      running_since_ = task_t_ = full_policy_t_ = state_.t_ns;
      policy_t_ = state_.t_ns - 1;
      bad_policies_ = 0;
      task_ = TaskOutput{};
      task_.phase = Phase::kApproach;
      sequencer_.start(r, state_);
      mode_ = Mode::kActive;
      report(out, r.id, RequestOutcome::kAccepted, "");
      return;
    case RequestKind::kNone:
    case RequestKind::kTune:
    case RequestKind::kRevert:
      return refuse("unknown request");
  }
}

double Controller::speed() const RT_SAFE { return mode_ == Mode::kDegraded ? kDegradedSpeed : 1.0; }

// The task is over: Ready again, but DEGRADED is left by a reset only.
void Controller::end_task() RT_SAFE {
  sequencer_.abort();
  task_.phase = Phase::kNone;
  if (mode_ == Mode::kActive) mode_ = Mode::kReady;
}

// Judges each policy of this task once.
void Controller::watch_quality(const Policy* policy) RT_SAFE {
  if (!policy || policy->t_ns <= policy_t_) return;
  policy_t_ = policy->t_ns;
  if (policy->quality == PolicyQuality::kFull) {
    bad_policies_ = 0;
    full_policy_t_ = policy->t_ns;
    return;
  }
  ++counters_.degraded_policies;
  if (++bad_policies_ == kBadPolicies) mode_ = Mode::kDegraded;
}

void Controller::watch(const ControlInput& in) RT_SAFE {
  const Readings& r = *in.readings;
  const auto trouble = [&](Mode mode, const char* why) {
    if (mode_ == Mode::kReady || mode_ == Mode::kActive || mode_ == Mode::kDegraded ||
        (mode_ == Mode::kHold && mode == Mode::kSettle)) {
      mode_ = mode;
      trouble_ = Name(why);
    }
  };
  if (r.emergency_stop) {
    ++counters_.emergency_stops;
    trouble(Mode::kSettle, "emergency stop");
  }
  if (r.driver_fault) {
    ++counters_.driver_faults;
    trouble(Mode::kSettle, "driver fault");
  }
  if (!joints_measured(r)) {
    ++counters_.invalid_readings;
    trouble(Mode::kSettle, "joint readings missing");
  }
  if (!task_running()) return;
  watch_quality(in.policy);
  if (mode_ == Mode::kDegraded && in.t_ns - full_policy_t_ > degraded_memory_ns_)
    trouble(Mode::kHold, "no policy of full quality");
  // The first policy of a task may take a moment; after that it must keep coming.
  if (in.t_ns - running_since_ > policy_memory_ns_ &&
      (!in.policy || in.t_ns - in.policy->t_ns > policy_memory_ns_)) {
    ++counters_.stale_policies;
    trouble(Mode::kHold, "policy too old");
  }
}

void Controller::carry_on(const ControlInput& in, double dt_s) RT_SAFE {
  const double speed = this->speed();
  task_ = sequencer_.step({task_t_, speed * dt_s, &state_, in.plan}, reference_);
  // Keyframes stand on the task's clock: the MPC wants the daemon's.
  const auto at = [&](TimeNs t) {
    return in.t_ns + static_cast<TimeNs>(static_cast<double>(t - task_t_) / speed);
  };
  for (EndEffectorReference& ee : reference_.ee) {
    for (int i = 0; i < ee.count; ++i) ee.keyframes[i].t_ns = at(ee.keyframes[i].t_ns);
  }
  for (int i = 0; i < reference_.base_count; ++i)
    reference_.base[i].t_ns = at(reference_.base[i].t_ns);
  reference_.speed_scale *= speed;
}

void Controller::step(const ControlInput& in, ControlOutput& out) RT_SAFE {
  const double dt_s = last_t_ ? std::clamp(to_seconds(in.t_ns - last_t_), 1e-4, 0.01) : 0.0025;
  if (last_t_) task_t_ += static_cast<TimeNs>(speed() * static_cast<double>(in.t_ns - last_t_));
  last_t_ = in.t_ns;
  out.status_count = 0;
  reset_ = false;

  estimator_.step(*in.readings, state_);
  state_.t_ns = in.t_ns;
  for (int i = 0; i < in.request_count; ++i) handle(in.requests[i], *in.readings, out);
  const bool was_running = task_running();
  if (!reset_) watch(in);
  const bool active = task_running();
  if (was_running && !active) {
    report(out, running_.id, RequestOutcome::kFailed, trouble_.view());
    end_task();
  }
  if (active) carry_on(in, dt_s);
  reference_.t_ns = in.t_ns;

  // A policy that was solved before this task began, or for another one, is not followed.
  const bool follow = active && !task_.ended && in.policy && in.policy->t_ns >= running_since_;
  // A policy that was not solved to its end may stem from before the task slowed down.
  const bool slow =
      follow && mode_ == Mode::kDegraded && in.policy->quality != PolicyQuality::kFull;
  for (int i = 0; i < model_->joints(); ++i) {
    state_.q_command[i] = mode_ == Mode::kIdle ? state_.q[i] : gate_.positions()[i];
  }
  Command request;
  wbc_.step({&state_, follow ? in.policy : nullptr, slow ? kDegradedSpeed : 1.0,
             active && task_.held, task_.free_direction_W, task_.gripper, dt_s},
            request);
  out.command = gate_.step(request, in.t_ns, dt_s, mode_);
  const GateReason reason = out.command.reason();
  if (active && (reason == GateReason::kScaled || reason == GateReason::kClipped)) {
    ++counters_.scaled_commands;
  } else if (active && reason != GateReason::kNone) {
    ++counters_.refused_commands;
  }

  if (active && task_.ended) {
    const bool done = task_.phase == Phase::kDone;
    report(out, running_.id, done ? RequestOutcome::kSucceeded : RequestOutcome::kFailed,
           task_.failure);
    if (mode_ == Mode::kActive) mode_ = Mode::kReady;
  } else if (active && to_seconds(in.t_ns - last_status_) > 1.0 / status_rate_hz_) {
    report(out, running_.id, RequestOutcome::kRunning, "");
    last_status_ = in.t_ns;
  }
  state_.mode = mode_;
  state_.phase = active ? task_.phase : Phase::kNone;
  out.activate_drives = reset_;
  out.hand_empty = !task_.held;
  ++state_.seq;
  *out.state = state_;
  *out.reference = reference_;
}

}  // namespace wb
