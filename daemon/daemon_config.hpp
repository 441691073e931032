// What wholebodyd.yaml says. Setup world: throws config::ConfigError.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "core/config/config.hpp"
#include "core/types/time.hpp"
#include "drivers/driver_host.hpp"

namespace wb {

struct LoopConfig {
  double rate_hz = 0;
  TimeNs latency_ns = 0;  // declared: Lockstep delivers results this long after the release
  int priority = 0;       // RealTime: SCHED_FIFO
};

struct DaemonConfig {
  std::filesystem::path robot;  // folder
  std::vector<PluginSpec> drivers;
  std::string interpreter;  // "oracle" (needs the simulator) or "none"
  std::uint64_t seed = 0;   // of the oracle's errors
  LoopConfig control, mpc, mapping, perception, frames;
  TimeNs command_timeout_ns = 0;
  std::vector<std::string> disabled_terms;  // of the MPC, studies only
  bool blind = false;  // the motion planner gets no map, studies only: what the map is worth

  // `plugin_folder`: where plugins without a path are looked for (the build's or
  // /usr/lib/wholebody).
  static DaemonConfig load(const std::filesystem::path& file,
                           const std::filesystem::path& plugin_folder);
  static DaemonConfig from(const config::Section& root, const std::filesystem::path& folder,
                           const std::filesystem::path& plugin_folder);
};

}  // namespace wb
