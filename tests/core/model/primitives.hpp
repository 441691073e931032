// The URDF's collision primitives, for tests that compare collision bodies with them. Setup world;
// SI units, link frames.
#pragma once
#include <urdf_model/model.h>

#include <Eigen/Geometry>
#include <cmath>
#include <string>
#include <vector>

#include "core/model/urdf_file.hpp"

namespace wb::test {

struct Primitive {
  enum class Kind { kBox, kCylinder, kSphere };

  std::string link, name;
  Kind kind = Kind::kBox;
  Eigen::Isometry3d X_LP = Eigen::Isometry3d::Identity();  // pose in the link
  // Box: half extents; cylinder: radius, radius, half height; sphere: radius.
  Eigen::Vector3d half = Eigen::Vector3d::Zero();

  // Signed distance from its surface to a point in the link's frame [m].
  double distance(const Eigen::Vector3d& p_L) const {
    const Eigen::Vector3d p = X_LP.inverse() * p_L;
    if (kind == Kind::kSphere) return p.norm() - half.x();
    Eigen::Vector3d d = p.cwiseAbs() - half;
    if (kind == Kind::kCylinder)
      d = {p.head<2>().norm() - half.x(), p.cwiseAbs().z() - half.z(), -1e9};
    return d.cwiseMax(0).norm() + std::min(d.maxCoeff(), 0.0);
  }

  // Points of its surface in the link's frame, at most `spacing` apart.
  std::vector<Eigen::Vector3d> surface(double spacing) const {
    std::vector<Eigen::Vector3d> out;
    const int n = 1 + static_cast<int>(std::ceil(2 * M_PI * half.maxCoeff() / spacing));
    for (int i = 0; i <= n; ++i) {
      for (int j = 0; j <= n; ++j) {
        const double u = 2.0 * i / n - 1, v = 2.0 * j / n - 1, angle = M_PI * u;
        if (kind == Kind::kBox) {
          for (const double s : {-1.0, 1.0}) {
            for (const Eigen::Vector3d& p :
                 {Eigen::Vector3d(s, u, v), Eigen::Vector3d(u, s, v), Eigen::Vector3d(u, v, s)}) {
              out.push_back(X_LP * p.cwiseProduct(half).eval());
            }
          }
        } else if (kind == Kind::kCylinder) {
          const Eigen::Vector3d rim(half.x() * std::cos(angle), half.x() * std::sin(angle), 0);
          out.push_back(X_LP * Eigen::Vector3d(rim.x(), rim.y(), v * half.z()));
          for (const double s : {-1.0, 1.0}) {
            out.push_back(X_LP * Eigen::Vector3d(v * rim.x(), v * rim.y(), s * half.z()));
          }
        } else {
          const double polar = 0.5 * M_PI * (v + 1);
          out.push_back(X_LP * (half.x() * Eigen::Vector3d(std::sin(polar) * std::cos(angle),
                                                           std::sin(polar) * std::sin(angle),
                                                           std::cos(polar))));
        }
      }
    }
    return out;
  }
};

inline std::vector<Primitive> primitives_of(const urdf::ModelInterface& urdf) {
  std::vector<Primitive> out;
  for (const auto& [name, link] : urdf.links_) {
    for (const urdf::CollisionSharedPtr& c : link->collision_array) {
      Primitive p{name, c->name, Primitive::Kind::kBox, to_eigen(c->origin)};
      if (c->geometry->type == urdf::Geometry::BOX) {
        p.half = 0.5 * to_eigen(static_cast<const urdf::Box&>(*c->geometry).dim);
      } else if (c->geometry->type == urdf::Geometry::CYLINDER) {
        const auto& g = static_cast<const urdf::Cylinder&>(*c->geometry);
        p.kind = Primitive::Kind::kCylinder;
        p.half = {g.radius, g.radius, 0.5 * g.length};
      } else if (c->geometry->type == urdf::Geometry::SPHERE) {
        p.kind = Primitive::Kind::kSphere;
        p.half.setConstant(static_cast<const urdf::Sphere&>(*c->geometry).radius);
      } else {
        throw config::ConfigError("link " + name + " collides as a mesh");
      }
      out.push_back(p);
    }
  }
  return out;
}

}  // namespace wb::test
