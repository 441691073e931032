// The CAN plugin's YAML: buses, drives, supervision. Setup world: parse() throws
// config::ConfigError naming key and range; a bus that would be too full is refused with the
// numbers. Keys: docs/how-to/can.md. SI units of the joint (prismatic: m where a key says rad).
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "drivers/can/drive_config.hpp"

namespace wb::can {

struct BusConfig {
  enum class Type { kSocketCan, kUnix };
  std::string name;
  Type type = Type::kSocketCan;
  std::string interface;       // socketcan
  std::filesystem::path path;  // unix
  double bit_rate = 1e6;
  bool paced = false;  // unix only: the bus's clock is the daemon's (lockstep)
  int priority = 0;    // of its thread, SCHED_FIFO; 0: ordinary
  double load = 0;     // worst case, share of bit_rate
};

struct PluginConfig {
  std::vector<BusConfig> buses;
  std::vector<DriveConfig> drives;
  Supervision supervision;
  double bus_load_max = 0.7;
  int pace_timeout_ms = 2000;  // paced: how long advance() waits for the hub

  bool paced() const { return !buses.empty() && buses.front().paced; }
  static PluginConfig parse(const std::string& text, const std::filesystem::path& folder);
};

}  // namespace wb::can
