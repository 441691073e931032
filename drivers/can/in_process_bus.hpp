// InProcessBus: one CAN bus as a value. One shared medium: whenever it is idle, the waiting frame
// with the lowest identifier is sent, takes its worst-case bit time, and reaches every other
// participant at the same instant. Virtual clock: nothing happens outside advance(). Any single
// thread; deterministic. Each participant has a transmit queue of finite length and, unless it
// takes frames as they come, a receive queue. Faults: bus_faults.hpp.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "drivers/can/bus_faults.hpp"
#include "drivers/can/can_port.hpp"

namespace wb::can {

// Whoever lives on the bus and reacts at once (a simulated drive). Called inside advance().
class BusParticipant {
 public:
  virtual ~BusParticipant() = default;
  virtual void received(const Frame& frame) noexcept = 0;  // frame.t_ns is now
  virtual void step(TimeNs now) noexcept = 0;              // each BusOptions::step_ns
};

struct BusOptions {
  double bit_rate = 1e6;
  int transmit_queue = 64;   // frames; the kernel's default is 10
  int receive_queue = 1024;  // frames
  TimeNs step_ns = 250'000;  // period of BusParticipant::step
};

class InProcessBus {
 public:
  explicit InProcessBus(const BusOptions& options = {});
  ~InProcessBus();
  InProcessBus(const InProcessBus&) = delete;
  InProcessBus& operator=(const InProcessBus&) = delete;

  // Setup: a new participant, by a name for the debugger. The port belongs to the bus. With
  // `participant`, frames go there and the port's receive() finds none.
  CanPort& attach(const std::string& name, BusParticipant* participant = nullptr);
  // The participant leaves the bus for good: its frames and its queue are forgotten.
  void detach(CanPort& port);

  // Lets the medium and the participants run until t (absolute, nothing if it has passed).
  void advance(TimeNs t) noexcept;
  TimeNs now() const;
  const BusOptions& options() const;
  BusFaults& faults();
  // The participant's cable: unplugged, it neither sends nor receives, and is not told.
  void set_plugged(CanPort& port, bool plugged) noexcept;
  // What its controller reports. kBusOff, kDown and kGone stop its traffic; frames that are queued
  // stay queued, as in the kernel. recover_ns > 0: back to kActive on its own after this time.
  void set_link(CanPort& port, LinkState state, TimeNs recover_ns = 0) noexcept;
  void report_error_frames(CanPort& port, int count) noexcept;
  std::uint64_t frames_on_wire() const;
  double load() const;  // share of the time so far that the medium was busy

 private:
  class Port;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace wb::can
