#include "drivers/sim/ray_caster.hpp"

#include <immintrin.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace wb::sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kLanes = 8;
using Lane = float __attribute__((vector_size(4 * kLanes)));
using Mask = std::int32_t __attribute__((vector_size(4 * kLanes)));

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr double kNear_m = 0.01;  // nothing nearer is drawn

inline Lane load(const float* p) { return _mm256_loadu_ps(p); }
inline Lane minimum(Lane a, Lane b) { return a < b ? a : b; }
inline Lane maximum(Lane a, Lane b) { return a > b ? a : b; }
inline Lane root(Lane a) { return _mm256_sqrt_ps(a); }
inline Lane splat(float a) { return Lane{} + a; }
inline float largest(Lane a) {
  float m = a[0];
  for (int i = 1; i < kLanes; ++i) m = std::max(m, a[i]);
  return m;
}

// The depths at which rays enter and leave a convex solid; entry beyond exit: missed.
struct Span {
  Lane entry, exit;
};

// The first crossing ahead of the camera; from inside, the exit.
inline Lane first(Span s) {
  const Lane t = s.entry > 0.0f ? s.entry : s.exit;
  const Mask hit = (s.entry <= s.exit) & (t > 0.0f);
  return hit ? t : splat(kInfinity);
}

inline Span slab(float origin, Lane direction, float half) {
  const Lane inverse = 1.0f / direction;
  const Lane a = (-half - origin) * inverse, b = (half - origin) * inverse;
  return {minimum(a, b), maximum(a, b)};
}

inline Span intersect(Span a, Span b) {
  return {maximum(a.entry, b.entry), minimum(a.exit, b.exit)};
}

// Rays against a unit ball (dims 3) or the unit cylinder about z (dims 2), from the point of
// closest approach: the direct quadratic loses a 6 mm bar at 3 m to rounding.
struct Round {
  Span span;
  Mask hit;
};
template <int kDims>
inline Round round(const Vector3f& o, const Lane d[3], float radius) {
  Lane dd = d[0] * d[0] + d[1] * d[1], od = o[0] * d[0] + o[1] * d[1];
  if constexpr (kDims == 3) {
    dd += d[2] * d[2];
    od += o[2] * d[2];
  }
  const Lane inverse = 1.0f / dd, middle = -od * inverse;
  Lane off = splat(0);
  for (int i = 0; i < kDims; ++i) {
    const Lane p = o[i] + middle * d[i];
    off += p * p;
  }
  const Lane inside = radius * radius - off;
  const Lane half = root(maximum(inside, splat(0)) * inverse);
  return {{middle - half, middle + half}, inside >= 0.0f};
}

inline Span only(Round r) {
  return {r.hit ? r.span.entry : splat(kInfinity), r.hit ? r.span.exit : splat(-kInfinity)};
}

}  // namespace

// A ray's direction in the solid's frame is across * x + down * y + ahead; its origin is the
// camera's centre.
struct RayCaster::Local {
  Vector3f origin, across, down, ahead;

  Local(const Isometry3d& X_CG, const Vector3d& scale) {
    const Eigen::Matrix3d R = scale.asDiagonal() * X_CG.linear().transpose();
    origin = (-(R * X_CG.translation())).cast<float>();
    across = R.col(0).cast<float>();
    down = R.col(1).cast<float>();
    ahead = R.col(2).cast<float>();
  }
};

void GeomPoses::take(const mjData& data, TimeNs t) noexcept {
  t_ns = t;
  std::copy_n(data.geom_xpos, position.size(), position.begin());
  std::copy_n(data.geom_xmat, rotation.size(), rotation.begin());
}

RayCaster::RayCaster(const mjModel& model, int max_width, int max_height)
    : solids_(model.ngeom),
      X_CG_(model.ngeom, Isometry3d::Identity()),
      stride_((max_width + kLanes - 1) / kLanes * kLanes),
      column_x_(stride_),
      depth_(static_cast<std::size_t>(stride_) * max_height),
      geom_(depth_.size()),
      block_far_(depth_.size() / kLanes),
      row_min_(max_height),
      row_max_(max_height) {
  candidates_.reserve(model.ngeom);
  for (int g = 0; g < model.ngeom; ++g) {
    Solid& s = solids_[g];
    const double* size = model.geom_size + 3 * g;
    s.type = model.geom_type[g];
    s.radius = size[0];
    s.half_length = size[1];
    s.half = Vector3d(size[0], size[1], size[2]);
    if (s.type == mjGEOM_SPHERE) s.half = Vector3d::Constant(s.radius);
    if (s.type == mjGEOM_CYLINDER) s.half = {s.radius, s.radius, s.half_length};
    if (s.type == mjGEOM_CAPSULE) s.half = {s.radius, s.radius, s.half_length + s.radius};
  }
}

// Widens the candidate by the projection of an edge of its box, cut at the near plane. With rows,
// also notes which columns each row needs: the silhouette of a convex solid runs along such edges.
void RayCaster::add_edge(const Vector3d& p, const Vector3d& q, Candidate& c, bool rows) noexcept {
  if (p.z() < kNear_m && q.z() < kNear_m) return;
  Vector3d a = p, b = q;
  const auto cut = [](Vector3d& behind, const Vector3d& ahead) {
    behind += (kNear_m - behind.z()) / (ahead.z() - behind.z()) * (ahead - behind);
    behind.z() = kNear_m;  // exactly: project() recognises a cut solid by it
  };
  if (a.z() < kNear_m) cut(a, b);
  if (b.z() < kNear_m) cut(b, a);
  double ua = camera_.fx * a.x() / a.z() + camera_.cx, va = camera_.fy * a.y() / a.z() + camera_.cy;
  double ub = camera_.fx * b.x() / b.z() + camera_.cx, vb = camera_.fy * b.y() / b.z() + camera_.cy;
  if (va > vb) {
    std::swap(ua, ub);
    std::swap(va, vb);
  }
  if (!rows) {
    const auto pixel = [](double x, int limit) {
      return static_cast<int>(std::floor(std::clamp(x, -1.0, limit + 1.0)));
    };
    c.near = std::min({c.near, static_cast<float>(a.z()), static_cast<float>(b.z())});
    c.u_min = std::min(c.u_min, pixel(std::min(ua, ub), camera_.width));
    c.u_max = std::max(c.u_max, pixel(std::max(ua, ub), camera_.width));
    c.v_min = std::min(c.v_min, pixel(va, camera_.height));
    c.v_max = std::max(c.v_max, pixel(vb, camera_.height));
    return;
  }
  // Over each row's band of one pixel the edge spans the columns between its crossings of the
  // band's borders.
  const double slope = vb - va > 1e-9 ? (ub - ua) / (vb - va) : 0.0;
  const int v0 = std::max(c.v_min, static_cast<int>(std::floor(std::max(va, -1.0))));
  const int v1 =
      std::min(c.v_max, static_cast<int>(std::floor(std::min(vb, camera_.height + 1.0))));
  for (int v = v0; v <= v1; ++v) {
    const double top = std::max<double>(v, va), bottom = std::min<double>(v + 1, vb);
    double u0 = ua + slope * (top - va), u1 = ua + slope * (bottom - va);
    if (slope == 0.0) {
      u0 = ua;
      u1 = ub;
    }
    row_min_[v] = std::min({row_min_[v], static_cast<float>(u0), static_cast<float>(u1)});
    row_max_[v] = std::max({row_max_[v], static_cast<float>(u0), static_cast<float>(u1)});
  }
}

// Without rows: the candidate's pixels and nearest depth; false if nothing of it is in the picture.
// With rows: fills the rows' columns.
bool RayCaster::project(const Isometry3d& X_CG, const Vector3d& half, Candidate& c,
                        bool rows) noexcept {
  Vector3d corner[8];
  for (int i = 0; i < 8; ++i) {
    corner[i] = X_CG * Vector3d(i & 1 ? half.x() : -half.x(), i & 2 ? half.y() : -half.y(),
                                i & 4 ? half.z() : -half.z());
  }
  if (rows && c.near <= static_cast<float>(kNear_m)) {
    // Cut by the near plane: the silhouette has edges of its own there.
    std::fill(row_min_.begin() + c.v_min, row_min_.begin() + c.v_max + 1, 0.0f);
    std::fill(row_max_.begin() + c.v_min, row_max_.begin() + c.v_max + 1, kInfinity);
    return true;
  }
  for (int i = 0; i < 8; ++i) {
    for (const int axis : {1, 2, 4}) {
      if (!(i & axis)) add_edge(corner[i], corner[i | axis], c, rows);
    }
  }
  if (rows) return true;
  c.u_min = std::max(c.u_min, 0);
  c.v_min = std::max(c.v_min, 0);
  c.u_max = std::min(c.u_max, camera_.width - 1);
  c.v_max = std::min(c.v_max, camera_.height - 1);
  return c.u_min <= c.u_max && c.v_min <= c.v_max;
}

template <class Hit>
void RayCaster::fill(const Candidate& c, const Local& local, const Hit& hit) noexcept {
  for (int v = c.v_min; v <= c.v_max; ++v) {
    const int u0 = std::max(c.u_min, static_cast<int>(std::max(row_min_[v], 0.0f)));
    const int u1 = std::min(
        c.u_max, static_cast<int>(std::min(row_max_[v], static_cast<float>(camera_.width))));
    const float y = static_cast<float>((v + 0.5 - camera_.cy) / camera_.fy);
    const Vector3f base = local.down * y + local.ahead;
    const std::size_t row = static_cast<std::size_t>(v) * stride_;
    for (int u = u0 / kLanes * kLanes; u <= u1; u += kLanes) {
      float& far = block_far_[(row + u) / kLanes];
      if (far <= c.near) continue;
      const Lane x = load(&column_x_[u]);
      Lane d[3];
      for (int i = 0; i < 3; ++i) d[i] = local.across[i] * x + base[i];
      const Lane t = hit(d);
      float* depth = &depth_[row + u];
      const Lane before = load(depth);
      const Mask nearer = t < before;
      const Lane after = nearer ? t : before;
      _mm256_storeu_ps(depth, after);
      _mm256_maskstore_epi32(&geom_[row + u], reinterpret_cast<__m256i>(nearer),
                             _mm256_set1_epi32(c.geom));
      far = largest(after);
    }
  }
}

void RayCaster::draw(const Candidate& c, const Isometry3d& X_CG) noexcept {
  const Solid& s = solids_[c.geom];
  const bool ellipsoid = s.type == mjGEOM_ELLIPSOID || s.type == mjGEOM_SPHERE;
  const Local local(X_CG, ellipsoid ? Vector3d(s.half.cwiseInverse()) : Vector3d::Ones());
  const Vector3f& o = local.origin;
  const Vector3f half = s.half.cast<float>();
  const float radius = static_cast<float>(s.radius), length = static_cast<float>(s.half_length);
  switch (s.type) {
    case mjGEOM_PLANE:
      return fill(c, local, [&](const Lane d[3]) {
        const Lane t = -o[2] / d[2];
        return t > 0.0f ? t : splat(kInfinity);
      });
    case mjGEOM_BOX:
      return fill(c, local, [&](const Lane d[3]) {
        return first(intersect(intersect(slab(o[0], d[0], half[0]), slab(o[1], d[1], half[1])),
                               slab(o[2], d[2], half[2])));
      });
    case mjGEOM_CYLINDER:
      return fill(c, local, [&](const Lane d[3]) {
        return first(intersect(only(round<2>(o, d, radius)), slab(o[2], d[2], length)));
      });
    case mjGEOM_CAPSULE:
      // The union of a cylinder and two balls: entered at the first entry, left (from inside) at
      // the last exit.
      return fill(c, local, [&](const Lane d[3]) {
        Span s = intersect(only(round<2>(o, d, radius)), slab(o[2], d[2], length));
        const Mask missed = s.entry > s.exit;
        s = {missed ? splat(kInfinity) : s.entry, missed ? splat(-kInfinity) : s.exit};
        for (const float end : {-length, length}) {
          const Span ball = only(round<3>({o[0], o[1], o[2] - end}, d, radius));
          s = {minimum(s.entry, ball.entry), maximum(s.exit, ball.exit)};
        }
        return first(s);
      });
    default:
      return fill(c, local, [&](const Lane d[3]) { return first(only(round<3>(o, d, 1.0f))); });
  }
}

void RayCaster::render(const GeomPoses& poses, const Isometry3d& X_SC,
                       const CameraIntrinsics& camera) noexcept {
  camera_ = camera;
  for (int u = 0; u < stride_; ++u)
    column_x_[u] = static_cast<float>((u + 0.5 - camera.cx) / camera.fx);
  const std::size_t pixels = static_cast<std::size_t>(stride_) * camera.height;
  std::fill_n(depth_.begin(), pixels, kInfinity);
  std::fill_n(geom_.begin(), pixels, -1);
  std::fill_n(block_far_.begin(), pixels / kLanes, kInfinity);

  const Isometry3d X_CS = X_SC.inverse(Eigen::Isometry);
  candidates_.clear();
  for (std::size_t g = 0; g < solids_.size(); ++g) {
    Isometry3d X_SG = Isometry3d::Identity();
    X_SG.linear() =
        Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(&poses.rotation[9 * g]);
    X_SG.translation() = Eigen::Map<const Vector3d>(&poses.position[3 * g]);
    X_CG_[g] = X_CS * X_SG;
    Candidate c{kInfinity, static_cast<std::int32_t>(g), camera.width, -1, camera.height, -1};
    if (solids_[g].type == mjGEOM_PLANE) {
      c = {std::numeric_limits<float>::max(),
           c.geom,
           0,
           camera.width - 1,
           0,
           camera.height - 1};  // drawn last
    } else if (!project(X_CG_[g], solids_[g].half, c, false)) {
      continue;
    }
    candidates_.push_back(c);
  }
  std::sort(candidates_.begin(), candidates_.end(), [](const Candidate& a, const Candidate& b) {
    return a.near < b.near || (a.near == b.near && a.geom < b.geom);
  });
  for (Candidate& c : candidates_) {
    if (solids_[c.geom].type == mjGEOM_PLANE) {
      c.near = 0;
      std::fill(row_min_.begin(), row_min_.end(), 0.0f);
      std::fill(row_max_.begin(), row_max_.end(), kInfinity);
    } else {
      std::fill(row_min_.begin() + c.v_min, row_min_.begin() + c.v_max + 1,
                static_cast<float>(camera.width));
      std::fill(row_max_.begin() + c.v_min, row_max_.begin() + c.v_max + 1, -1.0f);
      project(X_CG_[c.geom], solids_[c.geom].half, c, true);
    }
    draw(c, X_CG_[c.geom]);
  }
}

}  // namespace wb::sim
