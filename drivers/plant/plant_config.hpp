// What wb-plant's own file says: the simulated robot (as the sim plugin's section), and what stands
// before it. Setup world: throws config::ConfigError.
#pragma once
#include <filesystem>
#include <optional>
#include <string>

#include "drivers/can/plugin_config.hpp"
#include "drivers/plant/dds_side.hpp"

namespace wb::plant {

struct Config {
  std::filesystem::path folder;  // what file names in `sim` are relative to
  std::string sim;
  std::optional<can::PluginConfig> can;  // of the daemon's CAN plugin
  std::optional<DdsOptions> dds;
  std::filesystem::path gripper_port;  // empty: the gripper is commanded over DDS
  double gripper_opening_max_m = 0;

  static Config load(const std::filesystem::path& file);
};

}  // namespace wb::plant
