// DriveModel: the joint that a simulated drive turns. Port world (called inside the bus's advance):
// noexcept, no allocation. SI units on the joint's side: rad, rad/s, Nm (or m, m/s, N).
#pragma once
#include <algorithm>

namespace wb::can {

enum class DriveAction {
  kFree,      // no power: the joint moves as it likes
  kBrake,     // no power, mechanical brake on
  kPosition,  // position servo to the target
  kVelocity,  // velocity servo to the target
  kTorque,    // the target is the motor's torque at the joint
};

class DriveModel {
 public:
  virtual ~DriveModel() = default;
  virtual double position() const noexcept = 0;
  virtual double velocity() const noexcept = 0;
  virtual double torque() const noexcept = 0;
  // What the drive does from now on; called at each step of the node, also with nothing new.
  virtual void apply(DriveAction action, double target) noexcept = 0;
  // The drive lets its own time pass. A plant with a clock of its own ignores it.
  virtual void step(double dt_s) noexcept {}
};

// A joint without load: position and velocity targets are reached at once, a torque turns an
// inertia. For tests.
class IntegratorModel final : public DriveModel {
 public:
  explicit IntegratorModel(double position = 0, double inertia = 1)
      : position_(position), inertia_(inertia) {}
  double position() const noexcept override { return position_; }
  double velocity() const noexcept override { return velocity_; }
  double torque() const noexcept override { return torque_; }
  void apply(DriveAction action, double target) noexcept override {
    action_ = action;
    target_ = target;
  }
  void step(double dt_s) noexcept override {
    torque_ = action_ == DriveAction::kTorque ? target_ : 0;
    switch (action_) {
      case DriveAction::kBrake:
        velocity_ = 0;
        break;
      case DriveAction::kPosition:
        velocity_ = dt_s > 0 ? (target_ - position_) / dt_s : 0;
        break;
      case DriveAction::kVelocity:
        velocity_ = target_;
        break;
      case DriveAction::kFree:
      case DriveAction::kTorque:
        velocity_ += torque_ / inertia_ * dt_s;
        break;
    }
    position_ += velocity_ * dt_s;
  }

 private:
  double position_, velocity_ = 0, torque_ = 0, inertia_, target_ = 0;
  DriveAction action_ = DriveAction::kBrake;
};

}  // namespace wb::can
