#include "drivers/can/cia402/cia402_drive.hpp"

#include <algorithm>
#include <cmath>

namespace wb::can {
namespace {

constexpr TimeNs kMs = 1'000'000;
// Between a trouble that makes set-up necessary and its start: the drive hears the quick stop
// first.
constexpr TimeNs kSetupPauseNs = 200 * kMs;
// A gap after which a new position has nothing to be compared with.
constexpr TimeNs kPositionGapNs = 200 * kMs;
// Time that a drive gets to clear a fault before the next rising edge.
constexpr TimeNs kResetPauseNs = 20 * kMs;
constexpr int kModeWrongMax = 3;
constexpr double kRangeMargin = 0.1;  // of the joint's range: what a position may lie outside it
constexpr std::int64_t kJumpCounts = 16;  // encoder noise

}  // namespace

Cia402Drive::Cia402Drive(const DriveConfig& config, const Supervision& supervision, int index,
                         EventSink& events)
    : config_(config),
      supervision_(supervision),
      index_(index),
      events_(events),
      setup_(config, supervision) {
  static_assert(state_of(kNoStatusword) == DriveState::kUnknown);
  quality_window_ =
      std::clamp(static_cast<int>(std::lround(supervision.sync_rate_hz)), 1, kQualityWindow);
}

void Cia402Drive::report(Event event, std::uint32_t value) RT_SAFE {
  events_.report({now_, event, config_.bus, index_, value});
}

bool Cia402Drive::owns(const Frame& frame) const RT_SAFE {
  if (frame.extended || frame.remote || frame.error) return false;
  const auto n = static_cast<std::uint32_t>(config_.node_id);
  const std::uint32_t base = frame.id - n;
  return base == cob::kTpdo1 || base == cob::kTpdo2 || base == cob::kEmergency ||
         base == cob::kSdoAnswer || base == cob::kHeartbeat;
}

void Cia402Drive::received(const Frame& frame) RT_SAFE {
  now_ = frame.t_ns;
  heard_at_ = frame.t_ns;
  switch (frame.id - static_cast<std::uint32_t>(config_.node_id)) {
    case cob::kTpdo1:
      return take_tpdo1(frame);
    case cob::kTpdo2:
      return take_tpdo2(frame);
    case cob::kEmergency:
      return take_emergency(frame);
    case cob::kSdoAnswer:
      return setup_.sdo().received(frame);
    case cob::kHeartbeat:
      return take_heartbeat(frame);
    default:
      return;
  }
}

void Cia402Drive::take_tpdo1(const Frame& frame) RT_SAFE {
  if (phase_ != Phase::kReady || sync_at_ < 0) return;
  if (frame.length != 8) return report(Event::kPdoLength, frame.length);
  const TimeNs after = frame.t_ns - sync_at_;
  const auto window =
      static_cast<TimeNs>(supervision_.tpdo_window * static_cast<double>(supervision_.period_ns()));
  // Earlier than the SYNC: left over from the cycle before, or from before a reconnection.
  if (after < 0 || after > window)
    return report(Event::kTpdoLate, static_cast<std::uint32_t>(std::max<TimeNs>(0, after) / 1000));
  if (++answers_ > 1) return report(Event::kTpdoDuplicate);

  statusword_ = static_cast<std::uint16_t>(get_bytes(&frame.data[0], 2));
  fresh_ = true;
  const auto counts = static_cast<std::int32_t>(get_bytes(&frame.data[2], 4));
  const auto delta = static_cast<std::int32_t>(static_cast<std::uint32_t>(counts) -
                                               static_cast<std::uint32_t>(counts_));
  const TimeNs dt = frame.t_ns - measurement_.t_ns;
  if (!have_position_ || dt > kPositionGapNs || dt <= 0) {
    position_counts_ = counts;
    have_position_ = true;
  } else {
    const double limit = 2 * config_.velocity_max * to_seconds(dt) * config_.scale.counts_per_unit;
    if (std::abs(static_cast<double>(delta)) > limit + kJumpCounts) {
      if (!jumped_) report(Event::kPositionJump, static_cast<std::uint32_t>(std::abs(delta)));
      jumped_ = true;
      return;  // the last good position stays, marked invalid
    }
    position_counts_ += delta;
    if (supervision_.velocity_every != 1)
      measurement_.velocity = config_.scale.velocity(1) * delta / to_seconds(dt);
  }
  counts_ = counts;
  measurement_.position = config_.scale.position(position_counts_);
  measurement_.torque =
      config_.scale.torque(static_cast<std::int16_t>(get_bytes(&frame.data[6], 2)));
  measurement_.t_ns = frame.t_ns;
  const double range = config_.position_max - config_.position_min;
  if (range > 0 && (measurement_.position < config_.position_min - kRangeMargin * range ||
                    measurement_.position > config_.position_max + kRangeMargin * range)) {
    report(Event::kPositionRange, static_cast<std::uint32_t>(counts));
    jumped_ = true;
  }
}

void Cia402Drive::take_tpdo2(const Frame& frame) RT_SAFE {
  if (phase_ != Phase::kReady) return;
  if (frame.length != 7) return report(Event::kPdoLength, frame.length);
  if (supervision_.velocity_every == 1)
    measurement_.velocity =
        config_.scale.velocity(static_cast<std::int32_t>(get_bytes(&frame.data[0], 4)));
  mode_display_ = static_cast<std::int8_t>(frame.data[4]);
  measurement_.error_code = static_cast<std::uint32_t>(get_bytes(&frame.data[5], 2));
  have_mode_ = true;
  const bool right = mode_display_ == static_cast<std::int8_t>(config_.mode);
  mode_wrong_ = right ? 0 : std::min(mode_wrong_ + 1, kModeWrongMax);
}

void Cia402Drive::take_emergency(const Frame& frame) RT_SAFE {
  if (frame.length != 8) return;
  const auto code = static_cast<std::uint32_t>(get_bytes(&frame.data[0], 2));
  if (code == 0) return report(Event::kErrorReset);
  measurement_.error_code = code;
  report(Event::kEmergency, code);
}

void Cia402Drive::take_heartbeat(const Frame& frame) RT_SAFE {
  if (frame.length != 1) return;
  heartbeat_at_ = frame.t_ns;
  heartbeat_lost_ = false;
  const std::uint8_t state = frame.data[0] & 0x7F;
  if (state == nmt::kBootUp) {
    if (phase_ == Phase::kReady) report(Event::kBootUp);
    return begin_setup();
  }
  // The first beats after NMT start may have been under way before it.
  const TimeNs settled = ready_at_ + 2 * supervision_.heartbeat_ms * kMs;
  if (phase_ != Phase::kReady || state == nmt::kOperational || frame.t_ns < settled) return;
  if (setup_again_at_ < 0) {
    report(Event::kNmtState, state);
    setup_again_at_ = frame.t_ns + kSetupPauseNs;
  }
}

void Cia402Drive::begin_setup() RT_SAFE {
  phase_ = Phase::kSetup;
  setup_.restart();
  setup_again_at_ = -1;
  sync_at_ = -1;
  fresh_ = have_position_ = have_mode_ = false;
  missed_ = duplicates_ = answers_ = mode_wrong_ = 0;
  statusword_ = kNoStatusword;
  stop_option_written_ = -1;
  measurement_.valid = false;
}

void Cia402Drive::retry() RT_SAFE {
  if (phase_ == Phase::kFailed) begin_setup();
  if (jumped_) have_position_ = jumped_ = false;
}

void Cia402Drive::set_stop_action(StopAction action) RT_SAFE {
  // 0x605A: 6 quick-stop ramp and stay powered; 1 slow-down ramp, then power off; 2 quick-stop
  // ramp, then power off (the brake falls in).
  stop_option_ = action == StopAction::kHold ? 6 : action == StopAction::kDamped ? 1 : 2;
}

void Cia402Drive::check(TimeNs now, Goal goal) RT_SAFE {
  now_ = now;
  if (phase_ == Phase::kReady) {
    if (setup_again_at_ >= 0 && now >= setup_again_at_) {
      begin_setup();
    } else {
      check_freshness(now, goal);
      if (goal == Goal::kOn && last_goal_ == Goal::kOn) check_state(now, goal);
    }
  } else if (goal == Goal::kOn && last_goal_ == Goal::kOn) {
    // Not there while it should move: the activation ends.
    report(phase_ == Phase::kFailed ? setup_.trouble() : Event::kTpdoLost,
           phase_ == Phase::kFailed ? setup_.value() : 0);
  }
  update_status(now, goal);
}

void Cia402Drive::book_quality(bool in_time) RT_SAFE {
  in_time_[static_cast<std::size_t>(quality_at_)] = in_time;
  quality_at_ = (quality_at_ + 1) % quality_window_;
  quality_samples_ = std::min(quality_samples_ + 1, quality_window_);
  measurement_.quality =
      static_cast<double>(in_time_.count()) / static_cast<double>(quality_samples_);
}

void Cia402Drive::check_freshness(TimeNs now, Goal goal) RT_SAFE {
  if (sync_at_ >= 0) {
    book_quality(fresh_);
    if (fresh_) {
      missed_ = 0;
    } else {
      ++missed_;
      report(Event::kTpdoMissed, static_cast<std::uint32_t>(missed_));
      if (goal == Goal::kOn && missed_ >= supervision_.tpdo_lost_max)
        report(Event::kTpdoLost, static_cast<std::uint32_t>(missed_));
    }
    duplicates_ = answers_ > 1 ? duplicates_ + 1 : 0;
    if (duplicates_ >= supervision_.duplicates_max) {
      report(Event::kDuplicateNode);
      duplicates_ = 0;
    }
  }
  const TimeNs silent = now - heartbeat_at_;
  if (!heartbeat_lost_ && silent > supervision_.heartbeat_lost_ms * kMs) {
    heartbeat_lost_ = true;
    report(Event::kHeartbeatLost, static_cast<std::uint32_t>(silent / kMs));
    setup_again_at_ = now + kSetupPauseNs;
  }
}

void Cia402Drive::check_state(TimeNs now, Goal) RT_SAFE {
  const bool enabling_too_long =
      !was_enabled_ && now - on_since_ > supervision_.enable_timeout_ms * kMs;
  if (enabling_too_long) {
    const bool mode = have_mode_ && mode_wrong_ > 0;
    return report(mode ? Event::kModeMismatch : Event::kEnableTimeout,
                  mode ? static_cast<std::uint8_t>(mode_display_) : statusword_);
  }
  if (!fresh_) return;
  const DriveState s = state();
  if (s == DriveState::kUnknown) return report(Event::kUnknownStatusword, statusword_);
  if (s != DriveState::kOperationEnabled && s != DriveState::kQuickStopActive) passed_off_ = true;
  if (!was_enabled_) {
    if (s == DriveState::kOperationEnabled && passed_off_) {
      was_enabled_ = true;
      hold_ = target_ = measurement_.position;
      if (config_.mode != DriveMode::kCsp) target_ = 0;
      following_since_ = -1;
    }
    return;
  }
  if (s == DriveState::kFault || s == DriveState::kFaultReaction)
    return report(Event::kDriveFault, statusword_);
  if (s == DriveState::kQuickStopActive) return report(Event::kQuickStopActive, statusword_);
  if (s != DriveState::kOperationEnabled) return report(Event::kNotEnabled, statusword_);
  if (mode_wrong_ >= kModeWrongMax)
    return report(Event::kModeMismatch, static_cast<std::uint8_t>(mode_display_));
  if (statusword_ & statusword::kLimit) return report(Event::kInternalLimit, statusword_);
  if (config_.mode == DriveMode::kCsp && (statusword_ & statusword::kFollowingError))
    return report(Event::kFollowingErrorBit, statusword_);
  check_following(now);
}

void Cia402Drive::check_following(TimeNs now) RT_SAFE {
  if (config_.following_max <= 0 || config_.mode == DriveMode::kCst) return;
  const double measured =
      config_.mode == DriveMode::kCsp ? measurement_.position : measurement_.velocity;
  if (std::abs(target_ - measured) <= config_.following_max) {
    following_since_ = -1;
  } else if (following_since_ < 0) {
    following_since_ = now;
  } else if (now - following_since_ > supervision_.following_ms * kMs) {
    report(Event::kNotFollowing, static_cast<std::uint32_t>((now - following_since_) / kMs));
  }
}

void Cia402Drive::update_status(TimeNs now, Goal goal) RT_SAFE {
  const bool answers = missed_ < supervision_.tpdo_lost_max && have_position_;
  const DriveState s = state();
  JointStatus& status = measurement_.status;
  if (phase_ == Phase::kFailed) {
    status = JointStatus::kFault;
  } else if (phase_ == Phase::kSetup) {
    const bool heard = heard_at_ >= 0 && now - heard_at_ <= supervision_.heartbeat_lost_ms * kMs;
    status = heard ? JointStatus::kDisabled : JointStatus::kLost;
  } else if (!answers) {
    status = JointStatus::kLost;
  } else if (s == DriveState::kFault || s == DriveState::kFaultReaction) {
    // A fault that activation is about to reset is not news.
    const bool resetting = goal == Goal::kOn && !was_enabled_;
    status = resetting ? JointStatus::kDisabled : JointStatus::kFault;
  } else if (s == DriveState::kUnknown) {
    status = JointStatus::kUnknown;
  } else if (goal == Goal::kStop || s == DriveState::kQuickStopActive) {
    status = JointStatus::kStopped;
  } else if (s == DriveState::kOperationEnabled && goal == Goal::kOn && was_enabled_) {
    status = JointStatus::kFollowing;
  } else {
    status = JointStatus::kDisabled;
  }
  measurement_.valid = phase_ == Phase::kReady && answers && !jumped_ && measurement_.t_ns >= 0;
}

std::uint16_t Cia402Drive::reset_fault(TimeNs now) RT_SAFE {
  // Low first, so that the next word is a rising edge.
  if (!reset_high_) {
    if (now < reset_at_) return controlword::kDisableVoltage;
    if (reset_attempts_ >= supervision_.reset_attempts) {
      report(Event::kResetLimit, static_cast<std::uint32_t>(reset_attempts_));
      return controlword::kDisableVoltage;
    }
    ++reset_attempts_;
    reset_high_ = true;
    return controlword::kFaultReset;
  }
  reset_high_ = false;
  reset_at_ = now + kResetPauseNs;
  return controlword::kDisableVoltage;
}

std::uint16_t Cia402Drive::choose_controlword(TimeNs now, Goal goal) RT_SAFE {
  if (goal == Goal::kOff) return controlword::kDisableVoltage;
  if (goal == Goal::kStop) return controlword::kQuickStop;
  const bool known = was_enabled_ ? missed_ < supervision_.tpdo_lost_max : missed_ == 0;
  if (!known || !have_position_ || jumped_) return controlword::kDisableVoltage;
  switch (state()) {
    case DriveState::kFault:
      return reset_fault(now);
    case DriveState::kSwitchOnDisabled:
      return stop_option_written_ == stop_option_ ? controlword::kShutdown
                                                  : controlword::kDisableVoltage;
    case DriveState::kReadyToSwitchOn:
      return passed_off_ ? controlword::kSwitchOn : 0;
    case DriveState::kSwitchedOn:
      return passed_off_ && have_mode_ && mode_wrong_ == 0 && stop_option_written_ == stop_option_
                 ? controlword::kEnable
                 : controlword::kSwitchOn;
    case DriveState::kOperationEnabled:
      // Enabled by somebody else, or before this activation: power off first.
      return was_enabled_ || (passed_off_ && mode_wrong_ == 0) ? controlword::kEnable
                                                               : controlword::kDisableVoltage;
    default:
      return controlword::kDisableVoltage;
  }
}

bool Cia402Drive::write_stop_option(TimeNs now, Frame& frame) RT_SAFE {
  SdoClient& sdo = setup_.sdo();
  switch (sdo.result()) {
    case SdoClient::Result::kIdle:
      if (stop_option_written_ == stop_option_) return false;
      pending_option_ = stop_option_;  // may change while the transfer runs
      (void)sdo.write(object::kQuickStopOption, 0, 2, static_cast<std::uint32_t>(stop_option_));
      break;
    case SdoClient::Result::kDone:
      stop_option_written_ = pending_option_;
      sdo.cancel();
      return false;
    case SdoClient::Result::kBusy:
      break;
    default: {
      const bool aborted = sdo.result() == SdoClient::Result::kAborted;
      report(aborted ? Event::kSdoAbort : Event::kSdoTimeout,
             aborted ? static_cast<std::uint32_t>(sdo.abort_code()) : object::kQuickStopOption);
      const bool due = sdo.next_frame(now, frame);
      sdo.cancel();
      return due;
    }
  }
  return sdo.next_frame(now, frame);
}

void Cia402Drive::put_target(const JointTarget& target, bool enabled, Frame& frame) RT_SAFE {
  const UnitScale& scale = config_.scale;
  const bool follows = enabled && target.given;
  switch (config_.mode) {
    case DriveMode::kCsp: {
      const double q = follows ? target.value : enabled ? hold_ : measurement_.position;
      const auto counts = static_cast<std::uint32_t>(scale.position_counts64(q));
      put_bytes(&frame.data[3], 4, counts);
      frame.length = 7;
      target_ = q;
      break;
    }
    case DriveMode::kCsv:
      target_ = follows ? target.value : 0;
      put_bytes(&frame.data[3], 4, static_cast<std::uint32_t>(scale.velocity_counts(target_)));
      frame.length = 7;
      break;
    default:
      target_ = follows ? target.value : 0;
      put_bytes(&frame.data[3], 2, static_cast<std::uint16_t>(scale.torque_permille(target_)));
      frame.length = 5;
      break;
  }
}

int Cia402Drive::transmit(TimeNs now, Goal goal, const JointTarget& target, Frame* out) RT_SAFE {
  now_ = now;
  if (phase_ == Phase::kSetup) {
    last_goal_ = goal;
    const int frames = setup_.transmit(now, out);
    if (setup_.result() == DriveSetup::Result::kFailed) {
      report(setup_.trouble(), setup_.value());
      // Nobody there: go on asking. A wrong drive: wait for somebody to do something about it.
      if (setup_.trouble() == Event::kSdoTimeout) {
        setup_.restart();
      } else {
        phase_ = Phase::kFailed;
      }
    } else if (setup_.result() == DriveSetup::Result::kDone) {
      phase_ = Phase::kReady;
      ready_at_ = heartbeat_at_ = now;
      heartbeat_lost_ = false;
      report(Event::kDriveReady);
    }
    return frames;
  }
  if (phase_ == Phase::kFailed) {
    last_goal_ = goal;
    return 0;
  }
  if (goal == Goal::kOn && last_goal_ != Goal::kOn) {
    on_since_ = now;
    was_enabled_ = passed_off_ = reset_high_ = false;
    reset_attempts_ = 0;
    reset_at_ = now;
  }
  if (goal != Goal::kOn) was_enabled_ = false;
  last_goal_ = goal;
  Frame& rpdo = out[0];
  rpdo = {};
  rpdo.id = cob::kRpdo1 + static_cast<std::uint32_t>(config_.node_id);
  const std::uint16_t word = choose_controlword(now, goal);
  put_bytes(&rpdo.data[0], 2, word);
  rpdo.data[2] = static_cast<std::uint8_t>(config_.mode);
  put_target(target, was_enabled_ && word == controlword::kEnable, rpdo);
  int frames = 1;
  if (write_stop_option(now, out[frames])) ++frames;
  sync_at_ = now;
  answers_ = 0;
  fresh_ = false;
  return frames;
}

}  // namespace wb::can
