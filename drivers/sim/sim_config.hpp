// What the plugin was asked to simulate: robot, its sim.yaml, scene, spawn. Setup world; throws
// config::ConfigError.
#pragma once
#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/model/robot_config.hpp"
#include "core/types/time.hpp"
#include "drivers/sim/scene.hpp"

namespace wb::sim {

// Stiffness and damping that keep a joint where it is, and damping alone. Nm/rad, Nms/rad; of a
// prismatic joint N/m, Ns/m.
struct JointSimConfig {
  double armature = 0, hold_stiffness = 0, hold_damping = 0, damped_damping = 0;
};

struct WheelSimConfig {
  double armature = 0, servo_damping = 0, brake_stiffness = 0, brake_damping = 0;
  std::array<double, 3> friction{};  // sliding, spinning [m], rolling [m] of a differential drive
  // Of mecanum wheels: force along a roller's axis for slip along it, and its limit as a fraction
  // of the wheel's load.
  double roller_slip_nspm = 0, roller_friction = 0;
};

struct CastorSimConfig {
  std::vector<std::string> collisions;  // names in the URDF
  std::array<double, 3> friction{};
};

struct GripperSimConfig {
  double armature_kg = 0, servo_npm = 0, servo_nspm = 0, speed_mps = 0, force_max_n = 0;
  std::vector<std::string> pads;  // collision names in the URDF
  std::array<double, 3> friction{};
};

// sim.yaml beside robot.yaml. What the robot lacks stays empty.
struct RobotSimConfig {
  TimeNs step_ns = 0;
  std::string imu, wrench_link;        // links; empty: no such sensor
  std::vector<JointSimConfig> joints;  // in the order of q
  WheelSimConfig wheels;
  CastorSimConfig castors;
  GripperSimConfig gripper;
  std::map<std::string, std::array<double, 3>> colours;

  static RobotSimConfig load(const RobotConfig& robot);
};

struct Spawn {
  double x_m = 0, y_m = 0, yaw_rad = 0;
};

struct PluginConfig {
  RobotConfig robot;
  RobotSimConfig sim;
  Scene scene;
  std::uint64_t seed = 0;
  std::optional<Spawn> spawn;   // none: drawn from the seed
  std::vector<double> posture;  // q, rad or m
  bool colour = false;
  bool render_thread = false;

  // `text` is the plugin's YAML section; `folder` is what its file names are relative to.
  static PluginConfig parse(const std::string& text, const std::filesystem::path& folder);
};

}  // namespace wb::sim
