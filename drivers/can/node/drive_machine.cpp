#include "drivers/can/node/drive_machine.hpp"

#include <algorithm>
#include <cmath>

namespace wb::can {

void DriveMachine::go(DriveState state, TimeNs delay_ns) noexcept {
  if (next_ == state) return;
  next_ = state;
  power_left_ns_ = delay_ns;
  if (delay_ns == 0) state_ = state;
}

void DriveMachine::reset() noexcept {
  state_ = next_ = DriveState::kNotReady;
  mode_ = DriveMode::kNone;
  error_code_ = last_word_ = 0;
  quick_stop_option_ = 2;
  power_left_ns_ = 0;
}

void DriveMachine::quick_stop(bool own) noexcept {
  if (state_ != DriveState::kOperationEnabled) return;
  own_stop_ = own;
  ramp_velocity_ = model_.velocity();
  holding_ = false;
  go(DriveState::kQuickStopActive, 0);
}

void DriveMachine::fault(std::uint16_t code) noexcept {
  error_code_ = code;
  go(DriveState::kFault, 0);
}

void DriveMachine::connection_lost(int option, std::uint16_t code) noexcept {
  if (state_ == DriveState::kFault) return;
  if (option == 1) fault(code);
  if (option == 2) go(DriveState::kSwitchOnDisabled, 0);
  if (option != 3) return;
  if (state_ == DriveState::kOperationEnabled) {
    quick_stop();
  } else if (state_ != DriveState::kQuickStopActive) {
    go(DriveState::kSwitchOnDisabled, 0);
  }
}

void DriveMachine::control(std::uint16_t word, const Limits& limits) noexcept {
  const bool reset_edge = (word & ~last_word_ & controlword::kFaultReset) != 0;
  last_word_ = word;
  if (state_ == DriveState::kFault) {
    if (reset_edge && !limits.keep_fault) {
      error_code_ = 0;
      go(DriveState::kSwitchOnDisabled, 0);
    }
    return;
  }
  if (state_ == DriveState::kNotReady || state_ == DriveState::kFaultReaction) return;
  const bool voltage = word & 2, no_quick_stop = word & 4, switch_on = word & 1, enable = word & 8;
  if (!voltage) return go(DriveState::kSwitchOnDisabled, 0);
  if (!no_quick_stop) {
    if (state_ == DriveState::kOperationEnabled) return quick_stop();
    if (state_ != DriveState::kQuickStopActive) go(DriveState::kSwitchOnDisabled, 0);
    return;
  }
  if (!switch_on) {
    if (state_ != DriveState::kQuickStopActive)
      go(DriveState::kReadyToSwitchOn,
         state_ == DriveState::kSwitchOnDisabled ? limits.power_delay_ns : 0);
    return;
  }
  if (state_ == DriveState::kReadyToSwitchOn) {
    go(DriveState::kSwitchedOn, limits.power_delay_ns);
  } else if (!enable) {
    if (state_ == DriveState::kOperationEnabled) go(DriveState::kSwitchedOn, 0);
  } else if (!limits.refuse_enable) {
    // From quick stop active it is the optional transition 16: the drive moves again. The master
    // never asks for it.
    if (state_ == DriveState::kSwitchedOn) go(DriveState::kOperationEnabled, limits.power_delay_ns);
    if (state_ == DriveState::kQuickStopActive && quick_stop_option_ >= 5 && !own_stop_)
      go(DriveState::kOperationEnabled, 0);
  }
}

bool DriveMachine::follow(const DriveTargets& targets, TimeNs now, TimeNs period_ns) noexcept {
  if (state_ != DriveState::kOperationEnabled) return false;
  targets_ = targets;
  target_at_ = now + period_ns;
  return true;
}

void DriveMachine::step(TimeNs now, double dt_s, const Limits& limits) noexcept {
  if (state_ == DriveState::kNotReady) go(DriveState::kSwitchOnDisabled, 0);
  if (next_ != state_) {
    power_left_ns_ -= from_seconds(dt_s);
    if (power_left_ns_ <= 0) {
      state_ = next_;
      setpoint_ = model_.position();
      targets_ = {setpoint_, 0, 0};
    }
  }
  switch (state_) {
    case DriveState::kOperationEnabled:
      if (mode_ == DriveMode::kCsv) {
        model_.apply(DriveAction::kVelocity,
                     std::clamp(targets_.velocity, -limits.velocity_max, limits.velocity_max));
      } else if (mode_ == DriveMode::kCst) {
        model_.apply(DriveAction::kTorque, targets_.torque);
      } else if (mode_ == DriveMode::kCsp) {
        const double left_s = std::max(dt_s, to_seconds(target_at_ - now));
        const double velocity = std::clamp((targets_.position - setpoint_) / left_s,
                                           -limits.velocity_max, limits.velocity_max);
        setpoint_ += velocity * dt_s;
        model_.apply(DriveAction::kPosition, setpoint_);
      } else {
        model_.apply(DriveAction::kVelocity, 0);
      }
      break;
    case DriveState::kQuickStopActive: {
      const bool slow = quick_stop_option_ == 1 || quick_stop_option_ == 5;
      const double decel = slow ? limits.slow_down_decel : limits.quick_stop_decel;
      const double fall = decel * dt_s;
      const double speed = quick_stop_option_ == 0 ? 0 : std::abs(ramp_velocity_) - fall;
      if (!holding_ && speed > 0) {
        ramp_velocity_ = std::copysign(speed, ramp_velocity_);
        model_.apply(DriveAction::kVelocity, ramp_velocity_);
        break;
      }
      if (!holding_) setpoint_ = model_.position();
      holding_ = true;
      model_.apply(DriveAction::kPosition, setpoint_);
      if (quick_stop_option_ < 5) go(DriveState::kSwitchOnDisabled, 0);
      break;
    }
    default:
      model_.apply(DriveAction::kBrake, 0);
      break;
  }
  model_.step(dt_s);
}

std::uint16_t DriveMachine::statusword() const {
  switch (state_) {
    case DriveState::kSwitchOnDisabled:
      return 0x240;
    case DriveState::kReadyToSwitchOn:
      return 0x231;
    case DriveState::kSwitchedOn:
      return 0x233;
    case DriveState::kOperationEnabled:
      return 0x237 | statusword::kFollowing;
    case DriveState::kQuickStopActive:
      return 0x217;
    case DriveState::kFaultReaction:
      return 0x20F;
    case DriveState::kFault:
      return 0x208;
    default:
      return 0x200;
  }
}

}  // namespace wb::can
