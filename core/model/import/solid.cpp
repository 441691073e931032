#include "core/model/import/solid.hpp"

#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <cmath>
#include <numbers>

#include "core/config/config.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
constexpr double kPi = std::numbers::pi;

// Halves the longest edge until none is longer than `edge`.
void add_subdivided(TriangleMesh& out, const Vector3d& a, const Vector3d& b, const Vector3d& c,
                    double edge) {
  const double ab = (b - a).norm(), bc = (c - b).norm(), ca = (a - c).norm();
  if (std::max({ab, bc, ca}) <= edge) {
    const int n = static_cast<int>(out.vertices.size());
    out.vertices.insert(out.vertices.end(), {a, b, c});
    out.triangles.push_back({n, n + 1, n + 2});
  } else if (ab >= bc && ab >= ca) {
    const Vector3d m = 0.5 * (a + b);
    add_subdivided(out, a, m, c, edge);
    add_subdivided(out, m, b, c, edge);
  } else {  // turn until the longest edge is the first
    bc >= ca ? add_subdivided(out, b, c, a, edge) : add_subdivided(out, c, a, b, edge);
  }
}

void add_quad(TriangleMesh& out, const Vector3d& a, const Vector3d& b, const Vector3d& c,
              const Vector3d& d, double edge) {
  add_subdivided(out, a, b, c, edge);
  add_subdivided(out, a, c, d, edge);
}

TriangleMesh box(const Vector3d& h, double edge) {
  TriangleMesh out;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-1.0, 1.0}) {
      Vector3d o = Vector3d::Zero(), u = o, v = o;
      o[axis] = side * h[axis];
      u[(axis + 1) % 3] = h[(axis + 1) % 3];
      v[(axis + 2) % 3] = side * h[(axis + 2) % 3];  // outward normals
      add_quad(out, o - u - v, o + u - v, o + u + v, o - u + v, edge);
    }
  }
  return out;
}

// A prism about the cylinder: its sides touch the circle, so that it encloses it.
TriangleMesh prism(double radius, double half_height, double edge) {
  constexpr int kSides = 24;
  TriangleMesh out;
  const double r = radius / std::cos(kPi / kSides);
  const auto rim = [&](int i, double z) {
    const double a = 2 * kPi * i / kSides;
    return Vector3d(r * std::cos(a), r * std::sin(a), z);
  };
  for (int i = 0; i < kSides; ++i) {
    add_quad(out, rim(i, -half_height), rim(i + 1, -half_height), rim(i + 1, half_height),
             rim(i, half_height), edge);
    add_subdivided(out, {0, 0, half_height}, rim(i, half_height), rim(i + 1, half_height), edge);
    add_subdivided(out, {0, 0, -half_height}, rim(i + 1, -half_height), rim(i, -half_height), edge);
  }
  return out;
}

// A box's faces blown up onto a sphere, a little further out than it, so that they enclose it.
TriangleMesh ball(double radius) {
  TriangleMesh out = box(Vector3d::Ones(), 0.3);
  double nearest = 1;
  for (Vector3d& v : out.vertices) v.normalize();
  for (const auto& [a, b, c] : out.triangles) {
    const Vector3d n =
        (out.vertices[b] - out.vertices[a]).cross(out.vertices[c] - out.vertices[a]).normalized();
    nearest = std::min(nearest, std::abs(n.dot(out.vertices[a])));
  }
  for (Vector3d& v : out.vertices) v *= radius / nearest;
  return out;
}

double signed_volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    sum += mesh.vertices[a].dot(mesh.vertices[b].cross(mesh.vertices[c])) / 6;
  return sum;
}

double to_triangle(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  const Vector3d ab = b - a, ac = c - a, n = ab.cross(ac);
  const double nn = n.squaredNorm();
  if (nn > 0) {  // within the prism over the triangle?
    const Vector3d ap = p - a;
    const double v = ap.cross(ac).dot(n) / nn, w = ab.cross(ap).dot(n) / nn;
    if (v >= 0 && w >= 0 && v + w <= 1) return std::abs(ap.dot(n)) / std::sqrt(nn);
  }
  const auto to_edge = [&](const Vector3d& e, const Vector3d& d) {
    const double dd = d.squaredNorm();
    const double s = dd > 0 ? std::clamp((p - e).dot(d) / dd, 0.0, 1.0) : 0.0;
    return (p - e - s * d).norm();
  };
  return std::min({to_edge(a, ab), to_edge(b, c - b), to_edge(c, a - c)});
}

// Solid angle of a triangle from a point. Source: Van Oosterom and Strackee 1983.
double solid_angle(const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  const double la = a.norm(), lb = b.norm(), lc = c.norm();
  return 2 * std::atan2(a.dot(b.cross(c)),
                        la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
}

void collect(const aiScene& scene, const aiNode& node, const aiMatrix4x4& above,
             TriangleMesh& out) {
  const aiMatrix4x4 X = above * node.mTransformation;
  for (unsigned m = 0; m < node.mNumMeshes; ++m) {
    const aiMesh& mesh = *scene.mMeshes[node.mMeshes[m]];
    const int first = static_cast<int>(out.vertices.size());
    for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
      const aiVector3D p = X * mesh.mVertices[v];
      out.vertices.emplace_back(p.x, p.y, p.z);
    }
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      if (face.mNumIndices != 3) continue;  // points and lines
      const auto corner = [&](int i) { return first + static_cast<int>(face.mIndices[i]); };
      out.triangles.push_back({corner(0), corner(1), corner(2)});
    }
  }
  for (unsigned i = 0; i < node.mNumChildren; ++i) collect(scene, *node.mChildren[i], X, out);
}

}  // namespace

TriangleMesh TriangleMesh::read(const std::filesystem::path& file, const Vector3d& scale) {
  Assimp::Importer importer;
  // A link's axes are the URDF's, whatever a Collada file calls up.
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);
  const aiScene* scene =
      importer.ReadFile(file.string(), aiProcess_Triangulate | aiProcess_JoinIdenticalVertices);
  if (scene == nullptr || scene->mRootNode == nullptr) {
    throw config::ConfigError(file.string() +
                              ": is no mesh that can be read: " + importer.GetErrorString());
  }
  TriangleMesh out;
  collect(*scene, *scene->mRootNode, aiMatrix4x4(), out);
  for (Vector3d& v : out.vertices) {
    v = v.cwiseProduct(scale);
    if (!v.allFinite()) throw config::ConfigError(file.string() + ": holds a vertex that is NaN");
  }
  const bool mirrored = scale.prod() < 0;
  for (auto& t : out.triangles) {
    if (mirrored) std::swap(t[1], t[2]);
  }
  if (out.triangles.empty()) throw config::ConfigError(file.string() + ": holds no triangle");
  return out;
}

Solid Solid::moved(const Eigen::Isometry3d& X_ML) const {
  Solid out = *this;
  out.X_LS = X_ML * X_LS;
  return out;
}

double Solid::volume() const {
  switch (kind) {
    case Kind::kBox:
      return 8 * half.prod();
    case Kind::kCylinder:
      return 2 * kPi * half.x() * half.x() * half.z();
    case Kind::kSphere:
      return 4.0 / 3 * kPi * std::pow(half.x(), 3);
    case Kind::kMesh:
      break;
  }
  const auto [low, high] = bounds(mesh.vertices);
  const double inside = std::abs(signed_volume(mesh)), around = (high - low).prod();
  // Less than a hundredth of its box: a sheet, or a surface with holes.
  return inside > 0.01 * around && inside <= around ? inside : around;
}

TriangleMesh Solid::enclosing(double edge) const {
  TriangleMesh out;
  if (kind == Kind::kBox) out = box(half, edge);
  if (kind == Kind::kCylinder) out = prism(half.x(), half.z(), edge);
  if (kind == Kind::kSphere) out = ball(half.x());
  if (kind == Kind::kMesh) {
    for (const auto& [a, b, c] : mesh.triangles)
      add_subdivided(out, mesh.vertices[a], mesh.vertices[b], mesh.vertices[c], edge);
  }
  for (Vector3d& v : out.vertices) v = X_LS * v;
  return out;
}

std::vector<Vector3d> Solid::surface(double spacing) const {
  std::vector<Vector3d> out;
  if (kind == Kind::kBox || kind == Kind::kMesh) {
    out = enclosing(spacing).vertices;
    const auto less = [](const Vector3d& a, const Vector3d& b) {
      return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
    };
    std::sort(out.begin(), out.end(), less);
    out.erase(std::unique(out.begin(), out.end()), out.end());
    return out;
  }
  const int around = std::max(8, static_cast<int>(std::ceil(2 * kPi * half.x() / spacing)));
  const int rings = std::max(2, static_cast<int>(std::ceil(half.x() / spacing)));
  const int along = std::max(2, static_cast<int>(std::ceil(2 * half.z() / spacing)));
  for (int i = 0; i < around; ++i) {
    const double a = 2 * kPi * i / around;
    const Vector3d out_there(std::cos(a), std::sin(a), 0);
    if (kind == Kind::kSphere) {
      for (int j = 0; j <= 2 * rings; ++j) {
        const double polar = kPi * j / (2 * rings);
        out.push_back(half.x() *
                      (std::sin(polar) * out_there + std::cos(polar) * Vector3d::UnitZ()));
      }
      continue;
    }
    for (int j = 0; j <= along; ++j)
      out.push_back(half.x() * out_there + half.z() * (2.0 * j / along - 1) * Vector3d::UnitZ());
    for (int j = 0; j < rings; ++j) {
      for (const double side : {-1.0, 1.0})
        out.push_back(half.x() * j / rings * out_there + side * half.z() * Vector3d::UnitZ());
    }
  }
  for (Vector3d& p : out) p = X_LS * p;
  return out;
}

double Solid::distance(const Vector3d& p_L) const {
  const Vector3d p = X_LS.inverse() * p_L;
  if (kind == Kind::kSphere) return p.norm() - half.x();
  if (kind == Kind::kMesh) {
    double nearest = 1e9, winding = 0;
    for (const auto& [a, b, c] : mesh.triangles) {
      const Vector3d &va = mesh.vertices[a], &vb = mesh.vertices[b], &vc = mesh.vertices[c];
      nearest = std::min(nearest, to_triangle(p, va, vb, vc));
      winding += solid_angle(va - p, vb - p, vc - p);
    }
    return std::abs(winding) > 2 * kPi ? -nearest : nearest;
  }
  Vector3d d = p.cwiseAbs() - half;
  if (kind == Kind::kCylinder) d = {p.head<2>().norm() - half.x(), d.z(), -1e9};
  return d.cwiseMax(0).norm() + std::min(d.maxCoeff(), 0.0);
}

std::array<Vector3d, 2> bounds(const std::vector<Vector3d>& points) {
  std::array<Vector3d, 2> out{points.at(0), points.at(0)};
  for (const Vector3d& p : points) {
    out[0] = out[0].cwiseMin(p);
    out[1] = out[1].cwiseMax(p);
  }
  return out;
}

}  // namespace wb
