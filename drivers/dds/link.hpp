// The one thread that speaks DDS: takes samples, checks them, and leaves what is good in the
// Exchange and the frame rings; sends commands and ticks; holds the lease. Constructor, activate,
// deactivate, destructor: setup world (may block). Protocol: docs/how-to/dds.md.
#pragma once
#include <array>
#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "drivers/dds/counters.hpp"
#include "drivers/dds/dds_config.hpp"
#include "drivers/dds/exchange.hpp"
#include "drivers/dds/frame_ring.hpp"
#include "drivers/dds/frames.hpp"
#include "drivers/dds/truth.hpp"
#include "drivers/driver.h"

namespace wb::dds {

class Link {
 public:
  // Waits until everything that the configuration names has been heard of; throws
  // config::ConfigError naming what was not.
  Link(const DdsConfig& config, Exchange& exchange, Counters& counters);
  ~Link();

  const wb_description& description() const { return description_; }
  const CameraModel& camera_model(std::size_t camera) const { return cameras_[camera].model; }
  FrameRing& ring(std::size_t camera) { return *cameras_[camera].ring; }
  TruthStore& truth() { return truth_; }

  // Asks for the lease. Empty: granted; else why not.
  std::string activate(TimeNs command_timeout_ns, const wb_timeout_action* actions);
  void deactivate();

 private:
  struct Dds;    // entities of the participant
  struct Setup;  // what the setup world asks of the thread
  struct Camera {
    CameraModel model;
    std::unique_ptr<FrameRing> ring;
    StampGate gate;
    bool calibrated = true;      // the newest CameraInfo is that of the start
    std::uint64_t received = 0;  // messages, in this session
  };

  void describe();
  void connect();
  void run() noexcept;
  void take_all();
  void take_measurements();
  void take_frames();
  void take_grants();
  void adopt(const msg::RobotDescription& robot);
  template <class Message>
  void take_frame(std::size_t camera, const Message& message);
  void serve_setup();
  void send_commands();
  void send_tick(std::uint64_t number);
  void keep_lease();
  void lose_lease();
  void finish_tick();
  TimeNs stamp_now() const;
  Arrival arrival(TimeNs memory_ns) const;

  const DdsConfig& config_;
  Exchange& exchange_;
  Counters& counters_;
  wb_description description_{};
  std::unique_ptr<Dds> dds_;
  std::unique_ptr<Setup> setup_;

  // The low-level computer.
  std::uint64_t boot_ = 0;
  std::uint32_t robot_joint_count_ = 0;
  std::vector<std::uint32_t> joints_;           // its index of each of ours
  std::vector<std::uint32_t> timeout_actions_;  // its joints', bits
  std::vector<int> announced_;                  // its index of each of our cameras, -1
  std::uint64_t session_ = 0;
  MeasurementGate gate_;
  StampGate imu_gate_, wrench_gate_;
  std::vector<Camera> cameras_;
  TruthStore truth_;

  // The lease.
  std::uint64_t claim_ = 0, lease_ = 0;
  std::array<std::uint8_t, WB_DRIVER_MAX_JOINTS> actions_{};
  bool lease_seen_ = false;
  TimeNs lease_silence_ns_ = 0, next_keep_ns_ = 0;
  std::uint64_t sequence_ = 0, sent_order_ = 0;
  bool stop_sent_ = false;

  // The tick that is under way.
  std::uint64_t tick_sent_ = 0, answered_tick_ = 0, truth_wanted_ = 0, truth_given_up_ = 0;
  std::array<std::uint64_t, 8> frames_wanted_{};

  std::atomic<bool> stopping_{false};
};

}  // namespace wb::dds
