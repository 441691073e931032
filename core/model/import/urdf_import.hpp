// A URDF becomes a robot's folder: robot.urdf as the rooms need it, robot.yaml and every room's
// file. Setup world; deterministic. Everything guessed is a note, on the report and in robot.yaml.
// Throws config::ConfigError, with the URDF's line where there is one, for what cannot be
// controlled.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "core/model/import/posture_search.hpp"
#include "core/model/import/robot_structure.hpp"
#include "core/model/import/shape_fitting.hpp"

namespace wb {

struct ImportOptions {
  std::string name;
  StructureOptions structure;
  std::vector<std::filesystem::path> packages;
  SamplingOptions sampling;
  int spheres = 64;  // at most; the MPC's environment term takes no more
};

struct ImportReport {
  std::filesystem::path folder;
  RobotStructure structure;
  int capsules = 0, spheres = 0;
  FitQuality capsule_fit, sphere_fit;  // the worst body's
  int pairs = 0, apart = 0, always_near = 0, excluded = 0;
  Postures postures;
  std::vector<std::string> notes;
};

// Writes the files into `folder`, which exists.
ImportReport import_urdf(const std::filesystem::path& urdf, const std::filesystem::path& folder,
                         const ImportOptions& options);

}  // namespace wb
