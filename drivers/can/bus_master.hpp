// BusMaster: the CANopen master of one bus: hands frames to its drives, watches the link, sends
// each cycle's RPDOs, then SYNC (the control tick), and the master's heartbeat. Port world: one
// thread, no allocation, no clock: time is handed in. A cycle never sends what an earlier one could
// not, and nothing that was queued before a stop leaves after it.
#pragma once
#include <array>
#include <atomic>
#include <memory>
#include <vector>

#include "drivers/can/can_port.hpp"
#include "drivers/can/drive_config.hpp"
#include "drivers/can/events.hpp"
#include "drivers/can/joint_protocol.hpp"

namespace wb::can {

inline constexpr int kMaxDrives = 32;  // WB_DRIVER_MAX_JOINTS

// Why all drives stand; any thread sets it, the first reason stays until clear().
class StopLatch {
 public:
  bool stopped() const noexcept { return event_.load(std::memory_order_acquire) >= 0; }
  void stop(Event event) noexcept {
    int none = -1;
    event_.compare_exchange_strong(none, static_cast<int>(event), std::memory_order_acq_rel);
  }
  void clear() noexcept { event_.store(-1, std::memory_order_release); }
  int event() const noexcept { return event_.load(std::memory_order_acquire); }

 private:
  std::atomic<int> event_{-1};
};

// What the control thread wants of a bus; index: the driver's joint.
struct BusCommand {
  std::uint64_t seq = 0;
  bool active = false;
  std::uint32_t activation = 0;  // counts activate(); a new one starts drives afresh
  TimeNs alive_at_ns = 0;        // last accepted write or activation, the bus's clock
  TimeNs timeout_ns = 0;
  std::array<JointTarget, kMaxDrives> targets{};
  std::array<bool, kMaxDrives> none{};  // commanded to do nothing: its time-out action
  std::array<StopAction, kMaxDrives> actions{};
};

struct BusReadings {
  std::uint64_t seq = 0;
  TimeNs t_ns = 0;
  int ready = 0, failed = 0;  // drives
  std::uint64_t cycles = 0;
  PortStatus port;
  std::array<JointMeasurement, kMaxDrives> joints{};
};

class BusMaster {
 public:
  // drives: with their joint's index. Setup.
  struct Member {
    int joint;
    std::unique_ptr<JointProtocol> protocol;
    int node_id;
  };
  BusMaster(int bus, CanPort& port, const Supervision& supervision, std::vector<Member> drives,
            EventSink& events, StopLatch& latch);

  // Takes what has been received.
  void collect(TimeNs now) RT_SAFE;
  // Judges the cycle that ends, then sends the next one.
  void cycle(TimeNs now, const BusCommand& command) RT_SAFE;
  void publish(TimeNs now, BusReadings& readings) const RT_SAFE;
  bool carries() const { return carries_frames(status_.state); }

 private:
  void report(Event event, std::uint32_t value = 0, std::uint64_t times = 1) RT_SAFE;
  void take_foreign(const Frame& frame) RT_SAFE;
  void check_link(TimeNs now) RT_SAFE;
  Goal goal_of(const Member& drive, const BusCommand& command) const RT_SAFE;
  void send(TimeNs now, const BusCommand& command) RT_SAFE;

  int bus_;
  CanPort& port_;
  Supervision supervision_;
  std::vector<Member> drives_;
  EventSink& events_;
  StopLatch& latch_;
  TimeNs now_ = 0;
  PortStatus status_;
  std::uint64_t first_bus_offs_;  // the port's count when this master began
  TimeNs reopen_at_ = 0, heartbeat_at_ = 0;
  TimeNs closing_until_ = 0;
  bool was_active_ = false, was_stopped_ = false;
  std::uint32_t activation_ = 0;
  int refused_ = 0;  // cycles in a row
  std::uint64_t cycles_ = 0;
};

}  // namespace wb::can
