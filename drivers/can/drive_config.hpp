// What the master knows of a drive, and the times and thresholds of supervision. Setup fills them
// (plugin_config.hpp), everyone reads them. SI units of the joint.
#pragma once
#include <cstdint>
#include <string>

#include "core/types/time.hpp"
#include "drivers/can/cia402/states.hpp"
#include "drivers/can/unit_scale.hpp"

namespace wb::can {

struct DriveConfig {
  std::string joint;
  int bus = 0;
  int node_id = 0;
  bool wheel = false;
  DriveMode mode = DriveMode::kCsp;
  UnitScale scale;
  double position_min = 0, position_max = 0;  // rad; equal: unlimited
  double velocity_max = 0;                    // rad/s
  double effort_max = 0;                      // Nm
  // Largest difference between target and measured value: rad (csp), rad/s (csv); 0: not watched.
  double following_max = 0;
  double quick_stop_decel = 0;  // rad/s^2 (0x6085), 0: the drive's own
  // What 0x1000 and 0x1018 must say; 0: anything.
  std::uint32_t device_type = 0, vendor = 0, product = 0, revision = 0, serial = 0;
};

struct Supervision {
  double sync_rate_hz = 400;
  int velocity_every = 1;       // TPDO2 (velocity, mode display) with each n-th SYNC
  int tpdo_lost_max = 5;        // cycles in a row without a fresh TPDO: stop
  double tpdo_window = 0.8;     // a TPDO is fresh up to this share of a period after SYNC
  int duplicates_max = 5;       // cycles in a row with two TPDOs: duplicate node
  int refused_max = 5;          // cycles in a row whose frames the port did not take: stop
  int heartbeat_ms = 100;       // of each drive, and of the master
  int heartbeat_lost_ms = 350;  // without one: stop; the drives use the same for the master
  int rpdo_timeout_ms = 100;    // the drive's own, without RPDOs
  int sdo_timeout_ms = 50;
  int setup_timeout_ms = 5000;
  int enable_timeout_ms = 1000;
  int following_ms = 50;    // following_max exceeded for so long: stop
  int reset_attempts = 3;   // of a fault that does not clear, per activation
  int bus_off_max = 3;      // bus-offs since configure, then the bus is out of use
  int command_age_ms = 20;  // older commands are refused
  int master_id = 127;      // node id of the master's heartbeat

  TimeNs period_ns() const { return from_seconds(1.0 / sync_rate_hz); }
};

}  // namespace wb::can
