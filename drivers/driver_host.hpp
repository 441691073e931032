// Loads driver plugins, maps their joints and sensors to the robot's order, adapts the controller's
// commands to what each joint supports, and runs the plugins' life cycle. Constructor, activate,
// deactivate: setup world. read, write, advance: ports, control thread. next_frame: one other
// thread. read_counters: any thread.
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/model/robot_config.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/command.hpp"
#include "core/types/depth_frame.hpp"
#include "core/types/readings.hpp"
#include "drivers/command_adapter.hpp"
#include "drivers/plugin.hpp"

namespace wb {

class DriverHost {
 public:
  using Log = std::function<void(wb_log_level, const std::string&)>;

  // Loads and configures; the drives stay inactive. Throws std::runtime_error or
  // config::ConfigError naming plugin and cause: what Plugin and CommandAdapter refuse; a joint of
  // the robot that no plugin drives or two do; two plugins with an IMU (wrench, gripper, emergency
  // stop); a camera of another size than in robot.yaml.
  DriverHost(const RobotConfig& robot, const std::vector<PluginSpec>& plugins, Log log);
  ~DriverHost();

  // All plugins active, or none, false and a driver fault in the next reading. Joints hold, wheels
  // brake when commands cease for command_timeout_ns.
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

  // "<plugin>.<counter>" of every plugin; read_counters fills as many values.
  const std::vector<std::string>& counter_names() const { return counter_names_; }
  void read_counters(std::uint64_t* values) const;

 private:
  struct Instance {
    std::unique_ptr<Plugin> plugin;
    std::vector<int> cameras;  // description's camera -> robot's camera, -1: not used
    wb_readings readings{};
    wb_commands commands{};
  };
  struct Place {
    int instance = -1, joint = -1;
    CommandAdapter adapter;
    JointReading reading;
  };
  Place find(const std::string& joint, bool wheel) const;
  int provider(const char* what, std::uint32_t wb_description::*has) const;
  void map_cameras(Instance& instance);
  bool take(Place& place, JointReading& out) RT_SAFE;

  Log log_;
  RobotConfig robot_;
  std::vector<wb_command_kind> wanted_;  // of each instance
  std::vector<Instance> instances_;
  std::vector<Place> joints_, wheels_;
  int imu_ = -1, wrench_ = -1, gripper_ = -1;  // instances, -1: none has it
  std::vector<std::string> counter_names_;
  bool active_ = false;
  bool failed_ = false;  // a write or an activation, since the last read
};

}  // namespace wb
