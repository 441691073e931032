// Loads driver plugins, maps their joints and sensors to the robot's order, and runs their life
// cycle. Constructor, activate, deactivate: setup world. read, write, advance: ports, control
// thread. next_frame: one other thread.
#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/model/robot_config.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/command.hpp"
#include "core/types/depth_frame.hpp"
#include "core/types/readings.hpp"
#include "drivers/driver.h"

namespace wb {

struct PluginSpec {
  std::filesystem::path library;
  std::string config;            // text of its YAML section
  std::filesystem::path folder;  // what file names in it are relative to
};

class DriverHost {
 public:
  using Log = std::function<void(wb_log_level, const std::string&)>;

  // Loads and configures; the drives stay inactive. Throws std::runtime_error naming plugin and
  // cause (another ABI number, a joint of the robot that no plugin drives or two do, a failed
  // create).
  DriverHost(const RobotConfig& robot, const std::vector<PluginSpec>& plugins, Log log);
  ~DriverHost();

  // All plugins active, or none and false. Joints hold, wheels brake when commands cease for
  // command_timeout_ns.
  bool activate(TimeNs command_timeout_ns);
  void deactivate();
  bool active() const { return active_; }

  void read(TimeNs now, Readings& readings) RT_SAFE;
  void write(const SafeCommand& command) RT_SAFE;
  bool can_step() const;
  void advance(TimeNs t) RT_SAFE;

  // Copies the oldest waiting frame of any camera into `frame` (storage allocated before); false:
  // none. Ordinary thread.
  bool next_frame(DepthFrame& frame);

  // First plugin that answers to the extension's name, or null.
  const void* extension(const char* name, wb_driver** driver) const;

 private:
  struct Plugin {
    void* library = nullptr;
    const wb_driver_api* api = nullptr;
    wb_driver* driver = nullptr;
    wb_description description{};
    std::vector<int> cameras;  // description's camera -> robot's camera, -1: not used
    wb_readings readings{};
    wb_commands commands{};
    ~Plugin();
  };
  struct Place {
    int plugin = -1, joint = -1;
  };
  Place find(const std::string& joint) const;

  Log log_;
  RobotConfig robot_;
  std::vector<std::unique_ptr<Plugin>> plugins_;
  std::vector<Place> joints_, wheels_;
  bool active_ = false;
};

}  // namespace wb
