#include "core/model/import/shape_cloud.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace wb {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;

// Corners within a cell become one, until there are few enough triangles to ask all of them.
TriangleMesh thinned(const TriangleMesh& mesh, std::size_t most) {
  TriangleMesh out = mesh;
  const auto [low, high] = bounds(mesh.vertices);
  for (double cell = (high - low).maxCoeff() / 128; out.triangles.size() > most; cell *= 1.5) {
    out.triangles.clear();
    const Vector3d low_corner = low;
    const auto snap = [&](const Vector3d& v) -> Vector3d {
      return low_corner + cell * ((v - low_corner) / cell).array().round().matrix();
    };
    out.vertices = mesh.vertices;
    for (Vector3d& v : out.vertices) v = snap(v);
    for (const auto& t : mesh.triangles) {
      const Vector3d &a = out.vertices[t[0]], &b = out.vertices[t[1]], &c = out.vertices[t[2]];
      if (a != b && b != c && c != a) out.triangles.push_back(t);
    }
  }
  return out;
}

}  // namespace

ShapeCloud::ShapeCloud(const std::vector<Solid>& body) : solids(body) {
  Points corners;
  for (const Solid& s : body) {
    const TriangleMesh hull = s.enclosing(1e9);
    corners.insert(corners.end(), hull.vertices.begin(), hull.vertices.end());
  }
  const auto [low, high] = bounds(corners);
  const Vector3d size = high - low;
  // Some 2,000 cells in the box around, and at least a handful across.
  spacing = std::clamp(std::cbrt(std::max(size.prod(), 1e-9) / 2000), size.maxCoeff() / 60, 0.05);
  for (Solid& s : solids) {
    if (s.kind == Solid::Kind::kMesh) s.mesh = thinned(s.mesh, 3000);
    const Points more = s.surface(spacing);
    surface.insert(surface.end(), more.begin(), more.end());
  }
  const Eigen::Array3i cells = (size / spacing).array().ceil().max(1).cast<int>();
  for (int i = 0; i < cells.x(); ++i) {
    for (int j = 0; j < cells.y(); ++j) {
      for (int k = 0; k < cells.z(); ++k) {
        const Vector3d p =
            low + (Eigen::Array3d(i + 0.5, j + 0.5, k + 0.5) / cells.cast<double>() * size.array())
                      .matrix();
        const bool in = std::any_of(solids.begin(), solids.end(),
                                    [&](const Solid& s) { return s.distance(p) < 0; });
        if (in) inside.push_back(p);
      }
    }
  }
}

double ShapeCloud::beyond(const Vector3d& p) const {
  double nearest = 1e9;
  bool meshes = false;
  for (const Solid& s : solids) {
    if (s.kind == Solid::Kind::kMesh) {
      meshes = true;
    } else {
      nearest = std::min(nearest, s.distance(p));
    }
  }
  if (meshes) {
    double squared = 1e18;
    for (const Vector3d& q : surface) squared = std::min(squared, (p - q).squaredNorm());
    for (const Vector3d& q : inside) squared = std::min(squared, (p - q).squaredNorm());
    nearest = std::min(nearest, std::sqrt(squared));
  }
  return std::max(0.0, nearest);
}

// Source: the golden spiral.
const Points& unit_directions() {
  static const Points all = [] {
    constexpr int kCount = 96;
    Points out;
    for (int i = 0; i < kCount; ++i) {
      const double z = 1 - (2.0 * i + 1) / kCount, a = std::numbers::pi * (3 - std::sqrt(5.0)) * i;
      out.emplace_back(std::sqrt(1 - z * z) * std::cos(a), std::sqrt(1 - z * z) * std::sin(a), z);
    }
    return out;
  }();
  return all;
}

}  // namespace wb
