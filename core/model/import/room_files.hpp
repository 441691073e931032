// The YAML files of an imported robot's folder: one function a file, its values scaled to the robot
// by rules that stand in the file. Setup world. SI units.
#pragma once
#include <string>
#include <vector>

#include "core/model/import/posture_search.hpp"
#include "core/model/import/robot_structure.hpp"
#include "core/model/robot_config.hpp"

namespace wb {

struct ExcludedContact {
  std::string first, second, reason;
};

// What the files are made of.
struct RoomInputs {
  std::string source;  // the URDF that was imported, for comments
  RobotConfig robot;   // names, postures, spheres, capsules, pairs
  RobotStructure structure;
  std::vector<bool> prismatic;      // of each joint
  std::vector<JointLimits> limits;  // acceleration included
  // Of each joint's drive: its rotor, seen through the gear; all that it moves at most (largest
  // diagonal entry of the mass matrix, and the rotor); the joint's friction [Nm or N].
  std::vector<double> rotor, inertia, friction;
  std::vector<ExcludedContact> excluded;
  double velocity_max_mps = 0, yaw_rate_max_radps = 0;  // of the base
  double reach_m = 0, height_m = 0;                     // of the arm; of the stowed robot
  double limit_reach = 0;                               // rad or m
  std::string shapes_comment, pairs_comment, stowed_comment, ready_comment;
  // Circle on the floor within which what carries the robot holds it; radius 0: none.
  Eigen::Vector2d support_centre_m{0, 0};
  double support_radius_m = 0;
  std::vector<std::string> pads;  // collisions of the fingers
};

std::string robot_yaml(const RoomInputs& in);
std::string mpc_yaml(const RoomInputs& in);
std::string route_yaml(const RoomInputs& in);
std::string mapping_yaml(const RoomInputs& in);
std::string control_yaml(const RoomInputs& in);
std::string sim_yaml(const RoomInputs& in);

}  // namespace wb
