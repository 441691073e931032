#include "drivers/sim/painter.hpp"

#include <algorithm>
#include <cmath>

namespace wb::sim {
namespace {

using Eigen::Vector3d;

constexpr double kAmbient = 0.42, kDiffuse = 0.58;
constexpr double kTile_m = 0.5;  // of the floor
constexpr double kShadowBias_m = 0.02;

}  // namespace

Painter::Painter(const mjModel& model, const Vector3d& light_S)
    : looks_(model.ngeom), light_S_(light_S) {
  for (int g = 0; g < model.ngeom; ++g) {
    const float* c = model.geom_rgba + 4 * g;
    looks_[g] = {model.geom_type[g], Eigen::Map<const Vector3d>(model.geom_size + 3 * g),
                 Vector3d(c[0], c[1], c[2])};
  }
}

// Outward at a point on the solid's surface; not of unit length.
Vector3d Painter::normal(const Look& look, const Vector3d& p) const noexcept {
  const Vector3d& s = look.size;
  switch (look.type) {
    case mjGEOM_PLANE:
      return Vector3d::UnitZ();
    case mjGEOM_BOX: {
      int axis = 0;
      (s - p.cwiseAbs()).minCoeff(&axis);
      return std::copysign(1.0, p[axis]) * Vector3d::Unit(axis);
    }
    case mjGEOM_CYLINDER:
      if (s[1] - std::abs(p.z()) < s[0] - p.head<2>().norm())
        return {0, 0, std::copysign(1.0, p.z())};
      return {p.x(), p.y(), 0};
    case mjGEOM_CAPSULE:
      return {p.x(), p.y(), p.z() - std::clamp(p.z(), -s[1], s[1])};
    case mjGEOM_ELLIPSOID:
      return p.cwiseQuotient(s.cwiseAbs2());
    default:
      return p;
  }
}

Eigen::Isometry3d Painter::shadow_pose() const {
  Eigen::Isometry3d X_SC = Eigen::Isometry3d::Identity();
  X_SC.linear() << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  X_SC.translation() = light_S_;
  return X_SC;
}

CameraIntrinsics Painter::shadow_camera() {
  constexpr int kSize = 2048;
  constexpr double kFocal = 320;  // 145 degrees wide: from the ceiling to half-way down the walls
  return {kSize, kSize, kFocal, kFocal, 0.5 * kSize, 0.5 * kSize, 0, 1e3};
}

bool Painter::shadowed(const RayCaster& shadows, const Vector3d& p_S,
                       const Vector3d& n_S) const noexcept {
  const CameraIntrinsics k = shadow_camera();
  const Vector3d p = shadow_pose().inverse() * (p_S + kShadowBias_m * n_S);
  if (p.z() < 0.05) return false;
  const int u = static_cast<int>(std::floor(k.fx * p.x() / p.z() + k.cx)),
            v = static_cast<int>(std::floor(k.fy * p.y() / p.z() + k.cy));
  return u >= 0 && v >= 0 && u < k.width && v < k.height &&
         shadows.depth_row(v)[u] < p.z() - kShadowBias_m;
}

void Painter::paint(const RayCaster& caster, const GeomPoses& poses, const Eigen::Isometry3d& X_SC,
                    const CameraIntrinsics& camera, std::uint8_t* rgb,
                    const RayCaster* shadows) const noexcept {
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u, rgb += 3) {
      const std::int32_t geom = caster.geom_row(v)[u];
      if (geom < 0) {
        std::fill_n(rgb, 3, std::uint8_t{200});
        continue;
      }
      const Look& look = looks_[geom];
      const double z = caster.depth_row(v)[u];
      const Vector3d p_S = X_SC * Vector3d(z * (u + 0.5 - camera.cx) / camera.fx,
                                           z * (v + 0.5 - camera.cy) / camera.fy, z);
      const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R_SG(
          &poses.rotation[9 * geom]);
      const Eigen::Map<const Vector3d> p_SG(&poses.position[3 * geom]);
      const Vector3d n_S = (R_SG * normal(look, R_SG.transpose() * (p_S - p_SG))).normalized();
      const Vector3d to_light = (light_S_ - p_S).normalized();
      double light = std::max(0.0, n_S.dot(to_light));
      if (shadows != nullptr && light > 0 && shadowed(*shadows, p_S, n_S)) light = 0;
      double shade = kAmbient * (0.85 + 0.15 * n_S.z()) + kDiffuse * light;
      if (look.type == mjGEOM_PLANE) {
        const bool odd = (std::lround(std::floor(p_S.x() / kTile_m)) +
                          std::lround(std::floor(p_S.y() / kTile_m))) %
                             2 !=
                         0;
        shade *= odd ? 0.92 : 1.0;
      }
      for (int i = 0; i < 3; ++i)
        rgb[i] = static_cast<std::uint8_t>(std::clamp(255.0 * shade * look.rgb[i], 0.0, 255.0));
    }
  }
}

}  // namespace wb::sim
