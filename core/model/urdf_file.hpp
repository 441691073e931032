// Reads a robot's URDF and turns its poses into Eigen's. Setup world.
// Throws config::ConfigError naming the file. SI units; X_PC maps coordinates of the child to those
// of the parent.
#pragma once
#include <urdf_parser/urdf_parser.h>

#include <Eigen/Geometry>
#include <filesystem>

#include "core/config/config.hpp"

namespace wb {

inline urdf::ModelInterfaceSharedPtr read_urdf(const std::filesystem::path& file) {
  urdf::ModelInterfaceSharedPtr urdf = urdf::parseURDFFile(file.string());
  if (!urdf) throw config::ConfigError(file.string() + ": is not a readable URDF");
  return urdf;
}

inline Eigen::Vector3d to_eigen(const urdf::Vector3& v) { return {v.x, v.y, v.z}; }

inline Eigen::Isometry3d to_eigen(const urdf::Pose& pose) {
  double x, y, z, w;
  pose.rotation.getQuaternion(x, y, z, w);
  Eigen::Isometry3d X_PC = Eigen::Isometry3d::Identity();
  X_PC.linear() = Eigen::Quaterniond(w, x, y, z).normalized().toRotationMatrix();
  X_PC.translation() = to_eigen(pose.position);
  return X_PC;
}

inline bool is_movable(const urdf::Joint& joint) { return joint.type != urdf::Joint::FIXED; }

}  // namespace wb
