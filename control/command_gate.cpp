#include "control/command_gate.hpp"

#include <algorithm>
#include <cmath>

namespace wb {
namespace {

bool finite(const JointCommand& c) {
  return std::isfinite(c.position) && std::isfinite(c.velocity) && std::isfinite(c.torque) &&
         std::isfinite(c.stiffness) && std::isfinite(c.damping);
}

bool finite(const Command& c) {
  for (int i = 0; i < c.joint_count; ++i) {
    if (!finite(c.joints[i])) return false;
  }
  for (int i = 0; i < c.wheel_count; ++i) {
    if (!finite(c.wheels[i])) return false;
  }
  return std::isfinite(c.gripper.opening_m) && std::isfinite(c.gripper.force_n);
}

// Fastest set-point velocity from which steps of dt_s at full braking come to rest within
// `distance`: the sum of v, v - a dt, v - 2 a dt, ... over the n steps that it takes, solved for v.
// With equal steps the next bound is never out of reach.
double braking_velocity(double distance, double acceleration, double dt_s) {
  const double change = acceleration * dt_s, quantum = change * dt_s;
  const double n =
      std::max(1.0, std::ceil(0.5 * (std::sqrt(1.0 + 8.0 * distance / quantum) - 1.0)));
  return distance / (n * dt_s) + 0.5 * change * (n - 1.0);
}

}  // namespace

CommandGate::CommandGate(std::shared_ptr<const RobotModel> model)
    : model_(std::move(model)), kinematics_(model_->config().base) {}

void CommandGate::reset(const double* q) RT_SAFE {
  std::copy_n(q, model_->joints(), position_.begin());
  velocity_.fill(0.0);
  base_velocity_.fill(0.0);
}

void CommandGate::limit_joints(std::array<double, kMaxJoints>& velocity, double dt_s, bool& scaled,
                               bool& clipped) RT_SAFE {
  // One factor for all joints keeps the direction of the motion.
  const int n = model_->joints();
  double factor = 1.0;
  for (int i = 0; i < n; ++i) {
    const double limit = model_->limits(i).velocity;
    if (std::abs(velocity[i]) * factor > limit) factor = limit / std::abs(velocity[i]);
  }
  for (int i = 0; i < n; ++i) velocity[i] *= factor;
  double change = 1.0;
  for (int i = 0; i < n; ++i) {
    const double step = std::abs(velocity[i] - velocity_[i]),
                 limit = model_->limits(i).acceleration * dt_s;
    if (step * change > limit) change = limit / step;
  }
  scaled = scaled || factor < 1.0 || change < 1.0;
  for (int i = 0; i < n; ++i) {
    const JointLimits& limits = model_->limits(i);
    const double before = position_[i];
    velocity_[i] += change * (velocity[i] - velocity_[i]);
    if (limits.endless()) {
      position_[i] = before + velocity_[i] * dt_s;
      continue;
    }
    // A set-point never leaves the range, and brakes in time before its end; one that starts
    // outside may only move inwards.
    const double low = std::min(limits.lower, before), high = std::max(limits.upper, before);
    const double most = braking_velocity(high - before, limits.acceleration, dt_s);
    const double least = -braking_velocity(before - low, limits.acceleration, dt_s);
    clipped = clipped || velocity_[i] > most || velocity_[i] < least;
    velocity_[i] = std::clamp(velocity_[i], least, most);
    position_[i] = std::clamp(before + velocity_[i] * dt_s, low, high);
  }
}

void CommandGate::limit_base(const WheelKinematics::Twist& velocity, double dt_s,
                             bool& scaled) RT_SAFE {
  const BaseConfig& base = model_->config().base;
  const std::array<double, 3> speed = {base.velocity_max, base.velocity_max, base.yaw_rate_max};
  const std::array<double, 3> acceleration = {base.acceleration_max, base.acceleration_max,
                                              base.yaw_acceleration_max};
  double factor = 1.0;  // one factor keeps the curvature of the path
  for (int i = 0; i < 3; ++i) {
    if (std::abs(velocity[i]) * factor > speed[i]) factor = speed[i] / std::abs(velocity[i]);
  }
  double change = 1.0;  // and so does one for both changes when the base starts and stops
  for (int i = 0; i < 3; ++i) {
    const double step = std::abs(factor * velocity[i] - base_velocity_[i]),
                 limit = acceleration[i] * dt_s;
    if (step * change > limit) change = limit / step;
  }
  scaled = scaled || factor < 1.0 || change < 1.0;
  for (int i = 0; i < 3; ++i)
    base_velocity_[i] += change * (factor * velocity[i] - base_velocity_[i]);
}

SafeCommand CommandGate::step(const Command& request, TimeNs now, double dt_s, Mode mode) RT_SAFE {
  const int wheels = kinematics_.wheels();
  SafeCommand out;
  if (mode == Mode::kIdle) {
    velocity_.fill(0.0);
    base_velocity_.fill(0.0);
    return out;
  }

  // Stiffness, gravity torque and grip of a refused request still say how to stand still, if they
  // are numbers at all.
  const bool right_size = request.joint_count == model_->joints() && request.wheel_count == wheels;
  const bool usable = right_size && finite(request);

  std::array<double, kMaxJoints> velocity{};
  WheelKinematics::Twist base_velocity{};
  bool reachable = usable;  // a number, but so large that its velocity is none, is refused too
  if (usable) {
    for (int i = 0; i < model_->joints(); ++i) {
      velocity[i] = (request.joints[i].position - position_[i]) / dt_s;
      reachable = reachable && std::isfinite(velocity[i]);
    }
    WheelKinematics::Wheels speeds{};
    for (int i = 0; i < wheels; ++i) speeds[i] = request.wheels[i].velocity;
    base_velocity = kinematics_.twist(speeds);
    for (const double v : base_velocity) reachable = reachable && std::isfinite(v);
  }

  GateReason reason = GateReason::kNone;
  if (mode != Mode::kActive && mode != Mode::kDegraded) {
    reason = GateReason::kMode;
  } else if (!right_size) {
    reason = GateReason::kWrongSize;
  } else if (now - request.t_ns > kMemory_ns || request.t_ns > now) {
    reason = GateReason::kStale;
  } else if (!reachable) {
    reason = GateReason::kNotFinite;
  }
  const bool moves = reason == GateReason::kNone;
  if (!moves) {
    velocity.fill(0.0);
    base_velocity.fill(0.0);
  }
  bool scaled = false, clipped = false;
  limit_joints(velocity, dt_s, scaled, clipped);
  if (mode == Mode::kSettle) {
    base_velocity_.fill(0.0);  // brake
  } else {
    limit_base(base_velocity, dt_s, scaled);
  }

  Command& c = out.command_;
  c.t_ns = now;
  c.joint_count = model_->joints();
  c.wheel_count = wheels;
  for (int i = 0; i < c.joint_count; ++i) {
    JointCommand& j = c.joints[i];
    if (usable) last_good_[i] = request.joints[i];
    j = last_good_[i];
    j.position = position_[i];
    j.velocity = velocity_[i];
    const double torque_max = model_->limits(i).torque;
    if (std::abs(j.torque) > torque_max) {
      j.torque = std::clamp(j.torque, -torque_max, torque_max);
      clipped = true;
    }
    j.stiffness = std::max(0.0, j.stiffness);
    j.damping = std::max(0.0, j.damping);
  }
  const WheelKinematics::Wheels speeds = kinematics_.wheel_speeds(base_velocity_);
  for (int i = 0; i < wheels; ++i) {
    c.wheels[i].kind = CommandKind::kVelocity;
    c.wheels[i].velocity = speeds[i];
  }
  if (usable) last_grip_ = request.gripper;
  c.gripper.opening_m =
      std::clamp(last_grip_.opening_m, 0.0, model_->config().gripper_opening_max_m);
  c.gripper.force_n = std::max(0.0, last_grip_.force_n);
  if (moves && scaled) reason = GateReason::kScaled;
  if (moves && clipped) reason = GateReason::kClipped;
  out.reason_ = reason;
  return out;
}

}  // namespace wb
