// A URDF as the import reads it: every link and joint with its line, everything checked that the
// parser of the running system would let pass (NaN, loops, limits, inertias, mesh files). Setup
// world. Throws config::ConfigError: FILE:LINE, what is wrong, what to do. SI units; X_PC child in
// parent.
#pragma once
#include <Eigen/Geometry>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/model/import/solid.hpp"

namespace wb {

struct UrdfInertial {
  double mass = 0;
  Eigen::Isometry3d X_LI = Eigen::Isometry3d::Identity();
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  // about the centre of mass, axes of I
};

struct UrdfCollision {
  std::string name;  // may be empty
  Solid solid;       // in the link
  std::string mesh;  // the file, if it is one
};

struct UrdfLink {
  std::string name;
  int line = 0;
  std::optional<UrdfInertial> inertial;
  std::vector<UrdfCollision> collisions;
};

struct UrdfLimit {
  double lower = 0, upper = 0;
  std::optional<double> velocity, effort;  // none: not given, or zero
};

struct UrdfMimic {
  std::string joint;
  double multiplier = 1, offset = 0;
};

struct UrdfJoint {
  std::string name;
  int line = 0;
  enum class Type { kFixed, kRevolute, kContinuous, kPrismatic, kPlanar, kFloating } type{};
  std::string parent, child;
  Eigen::Isometry3d X_PC = Eigen::Isometry3d::Identity();
  Eigen::Vector3d axis = Eigen::Vector3d::UnitX();
  std::optional<UrdfLimit> limit;
  double damping = 0, friction = 0;
  std::optional<UrdfMimic> mimic;

  bool movable() const { return type != Type::kFixed; }
  bool turns() const { return type == Type::kRevolute || type == Type::kContinuous; }
};

struct UrdfDocument {
  std::filesystem::path file;
  std::string name;
  std::vector<UrdfLink> links;    // in the file's order
  std::vector<UrdfJoint> joints;  // every parent's joint before its children's
  std::string root;
  std::vector<std::string> notes;  // what was left out

  // `packages`: folders where the packages of package:// URIs are looked for, besides the URDF's
  // own folder and those above it.
  static UrdfDocument read(const std::filesystem::path& file,
                           const std::vector<std::filesystem::path>& packages = {});
  void write(const std::filesystem::path& to, const std::string& comment) const;

  const UrdfLink& link(const std::string& name) const;
  UrdfLink& link(const std::string& name);
  const UrdfJoint* joint(const std::string& name) const;        // null: none
  const UrdfJoint* joint_above(const std::string& link) const;  // null: the root
  std::vector<const UrdfJoint*> joints_below(const std::string& link) const;
  // From the root to a link: the joints passed.
  std::vector<const UrdfJoint*> path_to(const std::string& link) const;
  bool is_below(const std::string& link, const std::string& ancestor) const;  // or the same
  // Pose of every link in the root with all joints at zero.
  std::map<std::string, Eigen::Isometry3d> poses() const;

  [[noreturn]] void fail(int line, const std::string& message) const;
};

}  // namespace wb
