// A collision shape of a URDF as the import sees it: box, cylinder, sphere or a mesh read from a
// file (STL, OBJ, Collada). Setup world. SI units; L is the frame that the shape is placed in.
// Throws config::ConfigError for a file that is no mesh.
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace wb {

struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<int, 3>> triangles;

  // At least one triangle that is no point; every number finite.
  static TriangleMesh read(const std::filesystem::path& file, const Eigen::Vector3d& scale);
};

struct Solid {
  enum class Kind { kBox, kCylinder, kSphere, kMesh };

  Kind kind = Kind::kBox;
  Eigen::Isometry3d X_LS = Eigen::Isometry3d::Identity();
  // Box: half extents; cylinder: radius, radius, half height; sphere: radius, thrice; mesh: unused.
  Eigen::Vector3d half = Eigen::Vector3d::Zero();
  TriangleMesh mesh;  // kMesh only, in S

  Solid moved(const Eigen::Isometry3d& X_ML) const;  // the same shape seen from another frame
  // m^3; a mesh that is not closed counts as its convex neighbourhood's box.
  double volume() const;
  // Triangles in L that enclose a box, cylinder or sphere, and are a mesh; edges at most `edge`.
  TriangleMesh enclosing(double edge) const;
  // Points on the true surface in L, at most about `spacing` apart.
  std::vector<Eigen::Vector3d> surface(double spacing) const;
  // Signed distance from a point in L; of a mesh the inside is where its winding number says so.
  double distance(const Eigen::Vector3d& p_L) const;
};

// Lower and upper corner of the box about some points; throws for no points.
std::array<Eigen::Vector3d, 2> bounds(const std::vector<Eigen::Vector3d>& points);

}  // namespace wb
