// CanDriver: the plugin without its C face: all buses of one instance, the command watch, the stop
// latch, counters and log records. One control thread calls activate, deactivate, read, write,
// stop, advance. Paced: advance() runs the buses on the caller's clock, no threads. Otherwise each
// bus has its own thread (bus_thread.hpp), and Latest buffers in between. SI units, the host's
// clock.
#pragma once
#include <array>
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/rt/latest.hpp"
#include "core/rt/queue.hpp"
#include "drivers/can/bus_master.hpp"
#include "drivers/can/bus_thread.hpp"
#include "drivers/can/plugin_config.hpp"
#include "drivers/can/socket_bus.hpp"
#include "drivers/driver.h"

namespace wb::can {

// Whoever owns the virtual clock of paced buses.
class Pacer {
 public:
  virtual ~Pacer() = default;
  virtual TimeNs bus_time() const RT_SAFE = 0;
  // Runs all buses to the tick; false: one did not come along.
  virtual bool advance(const Tick& tick) RT_SAFE = 0;
};

class CanDriver final : public EventSink {
 public:
  // ports: one for each bus of the configuration, outliving the driver. pacer: null for real time.
  CanDriver(const PluginConfig& config, const std::vector<CanPort*>& ports, Pacer* pacer);
  ~CanDriver() override;

  // Setup: identifies and sets up every drive, waits until they are ready or a time is over.
  wb_status configure();
  // Asks for it; the drives get there within the next cycles, readings say how far they are.
  wb_status activate(TimeNs command_timeout_ns, const wb_timeout_action* actions);
  wb_status deactivate();
  // Stops the drives, then takes their power; the destructor does it, too.
  void close();
  void describe(wb_description& out) const;

  wb_status read(wb_readings& out) RT_SAFE;
  wb_status write(const wb_commands& commands) RT_SAFE;
  wb_status stop() RT_SAFE;
  wb_status advance(TimeNs t_ns) RT_SAFE;

  // Log records so far, as text; one ordinary thread, or the caller's own in tests.
  using Line = std::function<void(wb_log_level, const std::string&)>;
  void drain_log(const Line& line);
  void wait_for_log() noexcept { log_ticks_.wait(log_seen_); }
  void wake_log() noexcept {
    log_ticks_.fetch_add(1);
    log_ticks_.notify_all();
  }

  // Counters of wb.diagnostics/1; any thread.
  static const std::vector<const char*>& counter_names();
  void counters(std::uint64_t* values) const;
  std::uint64_t count(Event event) const {
    return counts_[static_cast<std::size_t>(event)].load(std::memory_order_relaxed);
  }
  int stop_event() const { return latch_.event(); }
  wb_state state() const { return state_; }
  const PluginConfig& config() const { return config_; }

  void report(const EventRecord& record, std::uint64_t times) RT_SAFE override;

 private:
  static constexpr int kPortCounters = 7;
  struct Bus {
    std::unique_ptr<BusMaster> master;
    Latest<BusCommand> command;
    Latest<BusReadings> readings;
    Queue<EventRecord, 256> events;
    std::unique_ptr<BusThread> thread;
    std::array<std::atomic<std::uint64_t>, kPortCounters> port_counts{};
  };
  TimeNs now() const RT_SAFE;  // the buses' clock
  void run_cycle(Bus& bus, TimeNs now) RT_SAFE;
  void collect(Bus& bus, TimeNs now) RT_SAFE;
  void publish_command(bool active, TimeNs alive_at) RT_SAFE;
  const JointMeasurement& joint(std::size_t i) RT_SAFE;
  wb_status check_joint(std::size_t i, const wb_commands& c, TimeNs now) RT_SAFE;
  bool all_ready() RT_SAFE;
  bool hopeless() const RT_SAFE;
  void refresh() RT_SAFE;
  std::string line_of(const EventRecord& record) const;

  PluginConfig config_;
  Pacer* pacer_;
  StopLatch latch_;
  std::atomic<bool> active_{false};
  std::vector<std::unique_ptr<Bus>> buses_;
  std::vector<const JointProtocol*> drives_;  // by joint; for their names
  Queue<EventRecord, 64> events_;             // the control thread's own
  std::array<std::atomic<std::uint64_t>, kEvents> counts_{};
  std::atomic<std::uint32_t> log_ticks_{0};
  std::uint32_t log_seen_ = 0;
  // Last time each event of a drive or bus went to the log; each row has one writer.
  std::vector<std::array<TimeNs, kEvents>> logged_at_;

  wb_state state_ = WB_UNCONFIGURED;
  TimeNs configured_at_ = 0;
  BusCommand command_;
  std::array<const BusReadings*, kMaxDrives> readings_{};  // by bus
  JointMeasurement nothing_;
  std::array<double, kMaxDrives> accepted_{};  // last accepted position targets
  std::array<bool, kMaxDrives> has_accepted_{};
  TimeNs accepted_at_ = 0;
  // Paced.
  bool clock_started_ = false, written_ = false;
  TimeNs host_offset_ = 0;  // bus time minus host time
  TimeNs next_cycle_ = 0, last_write_ = INT64_MIN / 2;
};

TimeNs monotonic_ns() noexcept;

}  // namespace wb::can
