// How full a bus gets: worst-case bits of every frame of a cycle, and the heartbeats, against the
// bit rate. Setup world. One drive a cycle: RPDO (controlword, mode, target), TPDO1 (8 bytes),
// TPDO2 (7 bytes, each velocity_every-th cycle); for all: SYNC.
#pragma once
#include <vector>

#include "drivers/can/can_frame.hpp"
#include "drivers/can/drive_config.hpp"

namespace wb::can {

// Share of the bit rate; 1 is a bus that is never idle.
inline double bus_load(const std::vector<DriveMode>& drives, const Supervision& s,
                       double bit_rate) {
  const auto bits = [](int bytes) { return static_cast<double>(worst_case_bits(bytes, false)); };
  double cycle = bits(0);
  for (const DriveMode mode : drives)
    cycle += bits(mode == DriveMode::kCst ? 5 : 7) + bits(8) + bits(7) / s.velocity_every;
  const double heartbeats = 1e3 / s.heartbeat_ms * bits(1) * static_cast<double>(drives.size() + 1);
  return (cycle * s.sync_rate_hz + heartbeats) / bit_rate;
}

}  // namespace wb::can
