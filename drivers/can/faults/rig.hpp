// Rig: the CAN driver with simulated drives on in-process buses and one virtual clock: what the
// fault suite, the driver's tests, the fuzzer and a bench stand on. Setup world (tests); no
// sockets, no threads. run() is the control loop at the SYNC rate: advance, read, write. SI units.
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/can/can_driver.hpp"
#include "drivers/can/node/cia402_node.hpp"

namespace wb::can {

// Forwards to the bus's port. May take less than it is given, as a full kernel queue does; hands
// over frames of a test's own; and shows what passes.
class GatePort final : public CanPort {
 public:
  explicit GatePort(CanPort& port) : port_(port) {}
  int send(const Frame* frames, int count) RT_SAFE override;
  int receive(Frame* frames, int capacity) RT_SAFE override;
  void flush() RT_SAFE override { port_.flush(); }
  PortStatus status() RT_SAFE override {
    PortStatus s = port_.status();
    s.refused += refused_;
    return s;
  }
  bool reopen() RT_SAFE override { return port_.reopen(); }

  int take_at_most = -1;
  std::vector<Frame> inject;  // received next, oldest last
  std::function<void(const Frame&)> sent, got;

 private:
  CanPort& port_;
  std::uint64_t refused_ = 0;
};

// Listens to everything on a bus and says what a test wants to know of the master's frames.
class Sniffer final : public BusParticipant {
 public:
  void received(const Frame& frame) noexcept override;
  void step(TimeNs) noexcept override {}
  std::uint64_t enabling = 0;  // RPDOs whose controlword enables operation
  std::uint64_t syncs = 0;
  TimeNs shortest_sync_ns = INT64_MAX;
  TimeNs last_sync_ns = -1;
};

// Sends the same frame as often as it is told to.
class Babbler final : public BusParticipant {
 public:
  Babbler(InProcessBus& bus, const Frame& frame, int per_step, int count)
      : frame_(frame), per_step_(per_step), left_(count), port_(bus.attach("babbler", this)) {}
  void received(const Frame&) noexcept override {}
  void step(TimeNs) noexcept override {
    for (int i = 0; i < per_step_ && left_ > 0; ++i, --left_) port_.send(&frame_, 1);
  }
  void hush() noexcept {
    left_ = 0;
    port_.flush();
  }

 private:
  Frame frame_;
  int per_step_, left_;
  CanPort& port_;
};

// Does something once, in the middle of a tick (the next step of the bus).
class Saboteur final : public BusParticipant {
 public:
  Saboteur(InProcessBus& bus, std::function<void()> what) : what_(std::move(what)) {
    bus.attach("saboteur", this);
  }
  void received(const Frame&) noexcept override {}
  void step(TimeNs) noexcept override {
    if (what_) what_();
    what_ = nullptr;
  }

 private:
  std::function<void()> what_;
};

struct RigOptions {
  int buses = 1;
  int drives = 4;  // on each bus, node ids 1, 2, ...
  DriveMode mode = DriveMode::kCsp;
  Supervision supervision;
  // What is changed before the drives start; index: the driver's joint.
  std::function<void(int, DriveConfig&, NodeOptions&)> adjust;
};

class Rig {
 public:
  explicit Rig(const RigOptions& options = {});
  ~Rig();

  static constexpr TimeNs kPeriod = 2'500'000;

  bool start();  // configure, activate, and half a second of motion; false: not all follow
  wb_status activate();
  // Another driver on the same buses, as after a restart of the daemon; configured.
  bool restart();
  // Control ticks for this long; `each` after every one, ends the run when it returns false.
  void run(double seconds, const std::function<bool()>& each = {});
  // The buses go on, the controller does not call.
  void hang(double seconds);
  // Time of one tick with nothing but the driver's calls.
  void tick();

  // Guests of the first bus.
  void babble(const Frame& frame, int per_step, int count);
  void hush();
  void in_next_step(std::function<void()> what);
  void second_node(int node_id);  // another drive with this id

  int joints() const { return static_cast<int>(driver->config().drives.size()); }
  std::vector<double> positions() const;
  bool all_follow() const;  // the driver says so, and the drives are enabled
  bool none_follows() const;
  bool any_enabled() const;            // at a drive
  TimeNs now() const { return now_; }  // host time
  std::string log() const { return log_; }

  std::vector<std::unique_ptr<InProcessBus>> buses;
  std::vector<std::unique_ptr<GatePort>> ports;
  std::vector<CanPort*> bus_ports;
  std::vector<std::unique_ptr<Sniffer>> sniffers;
  std::vector<std::unique_ptr<IntegratorModel>> models;
  std::vector<std::unique_ptr<Cia402Node>> nodes;
  std::vector<std::unique_ptr<Babbler>> babblers;
  std::vector<std::unique_ptr<Saboteur>> saboteurs;
  std::unique_ptr<Pacer> pacer;
  std::unique_ptr<CanDriver> driver;
  wb_readings readings{};
  wb_commands commands{};
  wb_status written = WB_OK;
  bool commanding = true;  // write in each tick
  // Lets a test spoil the command of a tick.
  std::function<void(wb_commands&)> spoil;

 private:
  void compose();
  void make_driver();
  RigOptions options_;
  PluginConfig config_;
  TimeNs now_ = 0;
  std::uint64_t ticks_ = 0;
  std::string log_;
  std::vector<double> start_;
  TimeNs motion_start_ = 0;
  bool moving_ = false;
};

}  // namespace wb::can
