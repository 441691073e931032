// What robot.yaml says: joints in the order that everyone uses, base, limits, cameras, collision
// bodies. Setup world. The rooms' own parameters stand beside it: mpc.yaml, mapping.yaml,
// control.yaml, sim.yaml.
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "core/types/depth_frame.hpp"

namespace wb {

enum class BaseKind { kFixed, kDifferentialDrive, kOmnidirectional };

struct BaseConfig {
  BaseKind kind = BaseKind::kFixed;
  std::string link;  // URDF link B, on the floor under the robot
  // Joints: left, right of a differential drive; front left, front right, rear left, rear right
  // (mecanum) of an omnidirectional base; none of a fixed one.
  std::vector<std::string> wheels;
  double wheel_radius_m = 0;
  double track_m = 0;               // between left and right wheels
  double wheelbase_m = 0;           // between front and rear wheels (omnidirectional)
  double velocity_max = 0;          // m/s, along each axis that the base can move in
  double yaw_rate_max = 0;          // rad/s
  double acceleration_max = 0;      // m/s^2, likewise
  double yaw_acceleration_max = 0;  // rad/s^2
  double bounding_radius_m =
      0;  // circle about B's origin that holds the robot in its stowed posture
};

struct JointConfig {
  std::string name;
  double acceleration_max = 0;  // rad/s^2; m/s^2 of a prismatic joint
  double velocity_max = 0;      // rad/s or m/s; 0: the URDF's
};

struct CameraConfig {
  std::string name;  // also the URDF link: optical frame (z forward, x right)
  CameraIntrinsics intrinsics;
  double rate_hz = 15;
};

struct SphereConfig {
  std::string link;
  Eigen::Vector3d centre;  // in the link's frame [m]
  double radius = 0;       // m
  bool masked = false;     // may enter the unit being opened (hand and wrist)
};

struct CapsuleConfig {
  std::string name;
  std::string link;
  Eigen::Vector3d p0, p1;  // ends of the segment in the link's frame [m]
  double radius = 0;       // m; a sphere where p0 = p1
};

struct RobotConfig {
  std::string name;
  std::filesystem::path folder;
  std::filesystem::path urdf;
  BaseConfig base;
  std::vector<JointConfig> joints;  // the order of q
  std::vector<std::string>
      fingers;  // prismatic joints of the gripper; total opening = sum of their positions
  std::string end_effector;                     // URDF link E
  std::vector<std::string> more_end_effectors;  // other links that a Reference may lead
  std::string shoulder_camera;                  // which camera measures the handle
  double gripper_opening_max_m = 0;
  std::vector<double> stowed;  // q [rad or m]: arm folded up over the base
  std::vector<double> ready;   // q [rad or m]: hand in front, at the height of a drawer's handle
  std::vector<CameraConfig> cameras;
  std::vector<SphereConfig> spheres;
  std::vector<CapsuleConfig> capsules;
  std::vector<std::array<std::string, 2>> self_pairs;  // capsule names checked against each other
  std::vector<std::array<std::string, 2>>
      contact_excluded;  // URDF links whose mutual contact the plant ignores

  // Reads folder/robot.yaml and checks it against the URDF. Throws config::ConfigError.
  static RobotConfig load(const std::filesystem::path& folder);
};

}  // namespace wb
