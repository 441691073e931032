// A kitchen as its file under config/scenes tells it: typed furniture, room, noise, view camera.
// Setup world. Frames: S the simulated world, z up, floor at z = 0; U a unit, origin on the floor
// in the middle of its front, x into the unit, y to the left of who looks at the front. Lengths in
// metres, angles in radians, masses in kg.
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/config/config.hpp"

namespace wb::sim {

// A convex solid. `half` is MuJoCo's size: half extents; radius and half length; radius.
struct Solid {
  enum class Kind { kBox, kCapsule, kCylinder };
  std::string name;
  Kind kind = Kind::kBox;
  Eigen::Vector3d half = Eigen::Vector3d::Zero();
  Eigen::Isometry3d X_body = Eigen::Isometry3d::Identity();
  std::string colour;
  bool handle = false;

  // Half extents of the box about the solid in its own axes.
  Eigen::Vector3d extent() const;
};

// A bar with two posts. The handle's frame G: origin at the bar's centre, x along the bar, z into
// the front.
struct Handle {
  Eigen::Isometry3d X_body = Eigen::Isometry3d::Identity();
  double radius_m = 0;
  double length_m = 0;
};

// The joint of a moving part, at its body's origin. Damping, friction and stiffness in N or Nm per
// unit.
struct PartJoint {
  bool revolute = false;
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();  // in the body's frame; positive values open
  double range = 0, damping = 0, friction = 0, stiffness = 0, armature = 0;
};

// What moves: a drawer or a door, with the one handle that opens it.
struct Part {
  std::string name;
  Eigen::Vector3d p_U =
      Eigen::Vector3d::Zero();  // body's origin in the unit, axes parallel to the unit's
  std::vector<Solid> solids;
  PartJoint joint;
  Handle handle;
  double mass_kg = 0;
  Eigen::Vector3d com = Eigen::Vector3d::Zero();
  Eigen::Vector3d inertia = Eigen::Vector3d::Zero();  // about the com, kg m^2
};

// A piece of furniture that stands still, and the parts that move in it.
struct Unit {
  std::string name;
  Eigen::Isometry3d X_SU = Eigen::Isometry3d::Identity();
  std::vector<Solid> solids;
  std::vector<Part> parts;
};

struct NoiseConfig {
  double depth_per_m = 0;    // standard deviation of depth over depth squared
  double depth_dropout = 0;  // fraction of pixels without return
  double camera_delay_s = 0;
  double encoder_rad = 0, encoder_radps = 0, effort_nm = 0;
  double gyro_radps = 0, gyro_walk_radps = 0;  // the bias' walk per square root of a second
  double accelerometer_mps2 = 0;
  double wrench_n = 0, wrench_nm = 0;
  double gripper_m = 0, gripper_n = 0;
};

struct ViewConfig {
  Eigen::Vector3d position = Eigen::Vector3d::Zero(), target = Eigen::Vector3d::Zero();
  double width_rad = 1;  // horizontal field of view
};

struct Scene {
  std::string name;
  std::array<double, 2> floor_x_m{}, floor_y_m{};
  std::vector<Unit> units;
  std::map<std::string, std::array<double, 3>> colours;
  NoiseConfig noise;
  ViewConfig view;
  Eigen::Vector3d light = Eigen::Vector3d::Zero();

  // `overrides` (may be null) maps a part's name to keys that replace the file's. Throws
  // config::ConfigError.
  static Scene load(const std::filesystem::path& file, const config::Section* overrides);
};

}  // namespace wb::sim
