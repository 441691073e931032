// Cia402Drive: the master's side of one CiA 402 drive: setup, heartbeat and NMT supervision,
// freshness of its process data, emergencies, the 402 state machine with time-outs, quick stop and
// fault reset, modes CSP, CSV, CST. Port world, one thread, no allocation. RPDO: controlword, mode,
// target. TPDO1: statusword, position, torque; TPDO2: velocity, mode display, error code.
// Invariant (tests/fuzz): a controlword that enables leaves only with goal kOn, after a fresh
// statusword that is switched on or operation enabled.
#pragma once
#include <array>
#include <bitset>

#include "drivers/can/cia402/drive_setup.hpp"
#include "drivers/can/joint_protocol.hpp"

namespace wb::can {

class Cia402Drive final : public JointProtocol {
 public:
  // index: the drive's number in event records. Setup: allocates, may throw.
  Cia402Drive(const DriveConfig& config, const Supervision& supervision, int index,
              EventSink& events);

  bool owns(const Frame& frame) const RT_SAFE override;
  void received(const Frame& frame) RT_SAFE override;
  void check(TimeNs now, Goal goal) RT_SAFE override;
  int transmit(TimeNs now, Goal goal, const JointTarget& target, Frame* out) RT_SAFE override;
  bool ready() const RT_SAFE override { return phase_ == Phase::kReady; }
  bool failed() const RT_SAFE override { return phase_ == Phase::kFailed; }
  void retry() RT_SAFE override;
  void set_stop_action(StopAction action) RT_SAFE override;
  const JointMeasurement& measurement() const RT_SAFE override { return measurement_; }
  const char* device_name() const RT_SAFE override { return setup_.device_name(); }

 private:
  enum class Phase : std::uint8_t { kSetup, kReady, kFailed };

  void report(Event event, std::uint32_t value = 0) RT_SAFE;
  void take_tpdo1(const Frame& frame) RT_SAFE;
  void take_tpdo2(const Frame& frame) RT_SAFE;
  void take_emergency(const Frame& frame) RT_SAFE;
  void take_heartbeat(const Frame& frame) RT_SAFE;
  void check_freshness(TimeNs now, Goal goal) RT_SAFE;
  void check_state(TimeNs now, Goal goal) RT_SAFE;
  void check_following(TimeNs now) RT_SAFE;
  void update_status(TimeNs now, Goal goal) RT_SAFE;
  void book_quality(bool in_time) RT_SAFE;
  void begin_setup() RT_SAFE;
  bool write_stop_option(TimeNs now, Frame& frame) RT_SAFE;
  void put_target(const JointTarget& target, bool enabled, Frame& frame) RT_SAFE;
  std::uint16_t choose_controlword(TimeNs now, Goal goal) RT_SAFE;
  std::uint16_t reset_fault(TimeNs now) RT_SAFE;
  DriveState state() const { return state_of(statusword_); }

  static constexpr int kQualityWindow = 1024;
  static constexpr std::uint16_t kNoStatusword = 0x006C;  // in no table: unknown

  DriveConfig config_;
  Supervision supervision_;
  int index_;
  EventSink& events_;
  DriveSetup setup_;
  Phase phase_ = Phase::kSetup;
  JointMeasurement measurement_;
  TimeNs now_ = 0;

  // Heartbeat and NMT.
  TimeNs heard_at_ = -1;     // any frame of the node
  TimeNs heartbeat_at_ = 0;  // the last one
  TimeNs ready_at_ = 0;
  TimeNs setup_again_at_ = -1;  // after a trouble that needs it; leaves time for the quick stop
  bool heartbeat_lost_ = false;

  // Process data.
  TimeNs sync_at_ = -1;  // of the SYNC that TPDOs answer
  int answers_ = 0;      // TPDO1s since that SYNC
  int missed_ = 0;       // SYNCs in a row without a fresh answer
  int duplicates_ = 0;   // SYNCs in a row with more than one
  bool fresh_ = false;   // the last SYNC was answered in time
  std::uint16_t statusword_ = kNoStatusword;
  std::int32_t counts_ = 0;
  std::int64_t position_counts_ = 0;  // unwrapped
  bool have_position_ = false, jumped_ = false;
  bool have_mode_ = false;
  int mode_wrong_ = 0;  // TPDO2s in a row with another mode
  std::int8_t mode_display_ = 0;
  std::bitset<kQualityWindow> in_time_;
  int quality_at_ = 0, quality_samples_ = 0, quality_window_ = 1;

  // State machine.
  Goal last_goal_ = Goal::kOff;
  bool passed_off_ = false;  // seen without power since the goal is kOn
  bool was_enabled_ = false;
  TimeNs on_since_ = 0;
  int reset_attempts_ = 0;
  TimeNs reset_at_ = 0;
  bool reset_high_ = false;
  double hold_ = 0;    // position where it was enabled
  double target_ = 0;  // last sent
  TimeNs following_since_ = -1;
  int stop_option_ = 2, stop_option_written_ = -1;
  int pending_option_ = 2;
};

}  // namespace wb::can
