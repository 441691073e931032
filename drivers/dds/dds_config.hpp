// The plugin's section of the daemon's YAML. Setup world: throws config::ConfigError.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "core/config/config.hpp"
#include "core/types/time.hpp"

namespace wb::dds {

struct CameraSource {
  std::string name;         // as robot.yaml has it
  std::string frame;        // that messages must carry: the optical frame
  bool points = false;      // PointCloud2 instead of Image
  std::string topic, info;  // ROS names without leading slash
  double rate_hz = 0, range_min_m = 0, range_max_m = 0;
};

struct DdsConfig {
  int domain = 0;
  std::string prefix;
  bool paced = false;
  bool all_joints = false;
  std::vector<std::string> joints;  // unless all_joints
  // "measurements": from joint_measurements; empty: none; else a topic of the standard message.
  std::string imu, wrench;
  bool gripper = false, truth = false;
  std::vector<CameraSource> cameras;
  TimeNs connect_timeout_ns = 0;  // for all that must be there at the start
  TimeNs sample_memory_ns = 0;    // older samples are stale when they arrive
  TimeNs silence_ns = 0;          // read fails without a newer measurement
  TimeNs frame_memory_ns = 0;
  TimeNs tick_timeout_ns = 0;  // longest wait in advance()

  bool commands() const { return all_joints || !joints.empty() || gripper; }
  // Whether the low-level computer's joint_measurements are needed at all.
  bool measurements() const {
    return commands() || imu == kMeasurements || wrench == kMeasurements || paced;
  }
  static constexpr char kMeasurements[] = "measurements";

  static DdsConfig parse(const std::string& text);
};

}  // namespace wb::dds
