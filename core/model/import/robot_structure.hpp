// What kind of robot a URDF describes: base and wheels, arm, hand, fingers, cameras. Setup world;
// every guess is a note, every refusal a config::ConfigError with the URDF's line and what to do.
// Works on the document: afterwards its root is B (on the floor, x forward, between the wheels),
// whatever the controller cannot move is fixed, and the links that the rooms ask for exist.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "core/model/import/urdf_document.hpp"
#include "core/model/robot_config.hpp"

namespace wb {

enum class ImportedBase { kFixed, kDifferentialDrive, kOmnidirectional };
const char* to_string(ImportedBase base);
// "fixed", "differential_drive", "omnidirectional"; throws std::out_of_range for others.
ImportedBase imported_base(const std::string& name);

struct StructureOptions {
  std::optional<ImportedBase> base;  // none: guessed
  std::string end_effector;          // empty: guessed
};

struct RobotStructure {
  ImportedBase base = ImportedBase::kFixed;
  std::vector<std::string>
      wheels;  // left, right; or front left, front right, rear left, rear right
  double wheel_radius_m = 0, track_m = 0, wheelbase_m = 0;
  double wheel_speed_radps = 0;      // limit of the slowest wheel
  std::vector<std::string> castors;  // names of collisions that slide on the floor
  std::vector<std::string> joints;   // of the arm, in order
  std::string end_effector, wrench_link, imu;
  std::vector<std::string> fingers;  // prismatic joints
  double gripper_opening_m = 0;
  std::vector<std::string> cameras;
  std::vector<std::string> notes;
};

RobotStructure find_structure(UrdfDocument& document, const StructureOptions& options);

// Steps of the above, in files of their own.
void find_base(UrdfDocument& document, const StructureOptions& options, RobotStructure& out);
void find_arm(UrdfDocument& document, const StructureOptions& options, RobotStructure& out);
// Limits, inertias and names that the file leaves open.
void fill_gaps(UrdfDocument& document, RobotStructure& out);

// A link that the document lacks, rigid with another; the name gets a number if it is taken.
std::string add_frame(UrdfDocument& document, const std::string& name, const std::string& parent,
                      const Eigen::Isometry3d& X_PC);
// Makes a joint fixed where it stands at `value`.
void lock_joint(UrdfDocument& document, const std::string& joint, double value);
bool contains_any(const std::string& name, const std::vector<std::string>& words);  // ignoring case

}  // namespace wb
