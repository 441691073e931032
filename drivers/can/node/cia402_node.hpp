// Cia402Node: a simulated CiA 402 drive (CANopen slave) on a bus. It has an object dictionary, an
// SDO server (expedited, segmented), NMT with boot-up and heartbeat, PDOs that the master may
// remap, SYNC, EMCY, a heartbeat consumer and an RPDO time-out that stop it when the master dies,
// the 402 state machine with its own quick-stop ramp, and fault switches for tests. Port world:
// lives inside the bus's advance(); one thread. The wire carries counts; UnitScale maps them to SI.
#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "drivers/can/in_process_bus.hpp"
#include "drivers/can/node/drive_model.hpp"
#include "drivers/can/unit_scale.hpp"

namespace wb::can {

struct NodeOptions {
  int node_id = 1;
  std::uint32_t device_type = 0x00020192;  // 0x1000: servo drive, profile 402
  std::uint32_t vendor = 0x5742, product = 0x402, revision = 0x10000, serial = 1;  // 0x1018
  std::string name = "simulated drive";                                            // 0x1008
  UnitScale scale;                        // the same as in the master's configuration
  std::uint32_t supported_modes = 0x380;  // 0x6502: CSP, CSV, CST
  double velocity_max = 10;               // rad/s: the drive clips its targets
  double quick_stop_decel = 20;           // rad/s^2 (0x6085)
  bool heartbeat_consumer = true;         // has 0x1016
  TimeNs enable_delay_ns = 4'000'000;  // each power transition (ready, on, enabled) takes so long
};

// What a test may break. All off: a healthy drive.
struct NodeFaults {
  bool silent = false;               // sends nothing at all, goes on working
  bool no_heartbeat = false;         // PDOs go on
  bool no_tpdo = false;              // heartbeat goes on
  bool frozen = false;               // measured values stay what they are, frames go on
  bool reversed = false;             // measured position runs against the motor
  bool refuse_sdo = false;           // aborts every transfer (0x08000020)
  bool ignore_sdo = false;           // never answers a transfer
  bool wrong_toggle = false;         // segmented transfers answer with the same toggle bit
  bool swap_mapping = false;         // read-back of the PDO mapping differs from what was written
  bool refuse_enable = false;        // stays switched on
  bool ignore_targets = false;       // enabled, it stays where it is
  bool ignore_stop = false;          // enabled, it runs on with its last targets, whatever is asked
  bool ignore_silence = false;       // does nothing when the master has gone
  bool keep_fault = false;           // a fault reset does not clear
  bool wrong_mode = false;           // mode display stays 0
  std::uint16_t statusword_xor = 0;  // flips bits of the statusword on the wire
  TimeNs tpdo_delay_ns = 0;          // TPDOs leave this long after SYNC
  std::int32_t position_jump = 0;    // counts, added to the measured position on the wire
};

class Cia402Node final : public BusParticipant {
 public:
  // Setup. Sends its boot-up message with the first step. port: its own on that bus.
  Cia402Node(const NodeOptions& options, InProcessBus& bus, DriveModel& model);
  ~Cia402Node() override;

  void received(const Frame& frame) noexcept override;
  void step(TimeNs now) noexcept override;

  NodeFaults& faults();
  CanPort& port();
  int node_id() const;
  // Power cycle: everything as after construction (the joint stays where it is), boot-up again.
  void reboot() noexcept;
  // A fault inside the drive: EMCY with this code, state Fault. 0x0000 sends "error reset" only.
  void raise(std::uint16_t error_code) noexcept;
  void send_emergency(std::uint16_t error_code) noexcept;  // EMCY only
  void enter_quick_stop() noexcept;                        // as by a limit switch
  void set_limit_bit(bool on) noexcept;                    // statusword bit 11
  void set_following_error_bit(bool on) noexcept;          // statusword bit 13
  void set_nmt(std::uint8_t state) noexcept;               // 4 stopped, 5 operational, 0x7F preop
  std::uint8_t nmt() const;
  std::uint16_t statusword() const;
  bool enabled() const;  // Operation enabled: the joint follows targets
  // Read access for tests: value of an object, 0 if there is none.
  std::uint64_t object(std::uint16_t index, std::uint8_t sub) const;
  std::uint64_t rpdos_followed() const;  // RPDOs that were taken over with a SYNC while enabled

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace wb::can
