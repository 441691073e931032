// DriveMachine: what happens inside a simulated drive below its CANopen side: the CiA 402 state
// machine with power transitions that take time, modes CSP, CSV, CST, the ramps of quick stop and
// slow-down, and the set-point interpolated between two SYNCs. Port world, one thread, no
// allocation. Targets come in SI units of the joint.
#pragma once
#include <cstdint>

#include "core/types/time.hpp"
#include "drivers/can/cia402/states.hpp"
#include "drivers/can/node/drive_model.hpp"

namespace wb::can {

struct DriveTargets {
  double position = 0, velocity = 0, torque = 0;
};

class DriveMachine {
 public:
  struct Limits {
    double velocity_max = 10;      // rad/s
    double quick_stop_decel = 20;  // rad/s^2
    double slow_down_decel = 5;    // rad/s^2
    TimeNs power_delay_ns = 4'000'000;
    bool refuse_enable = false;
    bool keep_fault = false;
  };

  explicit DriveMachine(DriveModel& model) : model_(model) {}

  void control(std::uint16_t word, const Limits& limits) noexcept;
  // New targets, to be reached one interpolation period from now on. false: not enabled, ignored.
  bool follow(const DriveTargets& targets, TimeNs now, TimeNs period_ns) noexcept;
  void step(TimeNs now, double dt_s, const Limits& limits) noexcept;

  // own: the drive's own decision; it then insists on being switched off first.
  void quick_stop(bool own = false) noexcept;
  void fault(std::uint16_t code) noexcept;
  // 0x6007: 0 nothing, 1 fault, 2 disable voltage, 3 quick stop.
  void connection_lost(int option, std::uint16_t code) noexcept;
  void reset() noexcept;  // power-up

  void set_mode(DriveMode mode) noexcept { mode_ = mode; }
  void set_quick_stop_option(int option) noexcept { quick_stop_option_ = option; }  // 0x605A
  DriveState state() const { return state_; }
  DriveMode mode() const { return mode_; }
  std::uint16_t error_code() const { return error_code_; }
  std::uint16_t statusword() const;

 private:
  void go(DriveState state, TimeNs delay_ns) noexcept;

  DriveModel& model_;
  DriveState state_ = DriveState::kNotReady, next_ = DriveState::kNotReady;
  TimeNs power_left_ns_ = 0;  // until next_ is reached
  DriveMode mode_ = DriveMode::kNone;
  int quick_stop_option_ = 2;
  std::uint16_t last_word_ = 0, error_code_ = 0;
  DriveTargets targets_;
  double setpoint_ = 0;       // position servo [rad]
  double ramp_velocity_ = 0;  // while stopping [rad/s]
  bool own_stop_ = false;
  bool holding_ = false;  // stopped, servo holds setpoint_
  TimeNs target_at_ = 0;
};

}  // namespace wb::can
