#include "mapping/voxel_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace wb {
namespace {

constexpr double kUnits = 1000.0;  // stored log-odds are thousandths
// Never seen; never seen and behind a surface. No hit or miss yields these values.
constexpr std::int16_t kUnknown = 0, kBehind = 1;

std::int16_t to_units(double log_odds) {
  return static_cast<std::int16_t>(std::lround(log_odds * kUnits));
}

// A voxel that was seen stays apart from the two special values.
std::int16_t seen(int value) {
  return static_cast<std::int16_t>(value == kUnknown || value == kBehind ? -1 : value);
}

int wrap(std::int64_t i, int n) { return static_cast<int>(((i % n) + n) % n); }

}  // namespace

VoxelMap::VoxelMap(const VoxelMapConfig& config)
    : config_(config),
      hit_(to_units(config.log_odds_hit)),
      miss_(to_units(config.log_odds_miss)),
      min_(to_units(config.log_odds_min)),
      max_(to_units(config.log_odds_max)),
      occupied_(to_units(config.log_odds_occupied)),
      floor_(static_cast<float>((config.floor_height_m - config.bottom_m) / config.resolution_m)),
      solid_behind_(static_cast<float>(config.solid_behind_m / config.resolution_m)),
      recentre_(static_cast<int>(std::lround(config.recentre_m / config.resolution_m))),
      corner_{-config.size[0] / 2, -config.size[1] / 2},
      voxels_(config.size[0] * config.size[1] * config.size[2]),
      ring_(voxels_),
      ended_(voxels_) {
  rays_.resize(config.rays_per_scan);
}

void VoxelMap::follow(const Eigen::Vector2d& p_WB) RT_SAFE {
  std::array<int, 2> corner = corner_;
  bool moved = false;
  for (int a = 0; a < 2; ++a) {
    const int base = static_cast<int>(std::floor(p_WB[a] / config_.resolution_m));
    const int centre = corner_[a] + config_.size[a] / 2;
    if (std::abs(base - centre) > recentre_) {
      corner[a] = base - config_.size[a] / 2;
      moved = true;
    }
  }
  if (!moved) return;
  const std::array<int, 2> old = corner_;
  corner_ = corner;
  const std::int64_t rows = corner_[1] - old[1];
  turn_ = wrap(turn_ + (corner_[0] - old[0]) + rows * config_.size[0], voxels_);
  // What was not in the old window is unknown.
  const auto [nx, ny, nz] = config_.size;
  for (int j = 0; j < ny; ++j) {
    const int row_y = corner_[1] + j;
    const bool row_stays = row_y >= old[1] && row_y < old[1] + ny;
    const int stay_first = row_stays ? std::clamp(old[0] - corner_[0], 0, nx) : nx;
    const int stay_last = row_stays ? std::clamp(old[0] + nx - corner_[0], 0, nx) : nx;
    for (int k = 0; k < nz; ++k) {
      const int row = (k * ny + j) * nx;
      for (int i = 0; i < stay_first; ++i) ring_[stored(row + i)].log_odds = kUnknown;
      for (int i = stay_last; i < nx; ++i) ring_[stored(row + i)].log_odds = kUnknown;
    }
  }
}

void VoxelMap::clear() RT_SAFE {
  for (Voxel& v : ring_) v.log_odds = kUnknown;
}

Eigen::Vector3d VoxelMap::origin_W() const {
  return {corner_[0] * config_.resolution_m, corner_[1] * config_.resolution_m, config_.bottom_m};
}

float VoxelMap::log_odds(const Eigen::Vector3d& p_W) const RT_SAFE {
  const Eigen::Vector3f p = ((p_W - origin_W()) / config_.resolution_m).cast<float>();
  if (!inside(p)) return 0.0f;
  const std::int16_t value = ring_[stored(place(p))].log_odds;
  return value == kBehind ? 0.0f : static_cast<float>(value / kUnits);
}

void VoxelMap::begin_scan(const Eigen::Isometry3d& X_WC) RT_SAFE {
  const double scale = 1.0 / config_.resolution_m;
  rotation_ = (scale * X_WC.linear()).cast<float>();
  camera_ = (scale * (X_WC.translation() - origin_W())).cast<float>();
  ray_count_ = 0;
  if (++scan_ == 0) {
    // The count has gone round: no voxel may seem to have been changed by the scans to come.
    for (Voxel& v : ring_) v.scan = 0;
    std::fill(ended_.begin(), ended_.end(), std::uint16_t{0});
    scan_ = 1;
  }
}

void VoxelMap::add(const Eigen::Vector3f& p_C, RayEnd kind) RT_SAFE {
  Eigen::Vector3f end = camera_ + rotation_ * p_C;
  if (!inside(end)) {
    if (!inside(camera_)) return;
    end = clip(camera_, end);
    kind = RayEnd::kOpen;
  } else if (kind == RayEnd::kSurface && end.z() < floor_) {
    kind = RayEnd::kOpen;
  }
  const int i = stored(place(end));
  Voxel& voxel = ring_[i];
  std::uint16_t& last = kind == RayEnd::kSurface ? voxel.scan : ended_[i];
  if (last == scan_) return;
  last = scan_;
  if (kind == RayEnd::kSurface) {
    voxel.log_odds = seen(std::min(voxel.log_odds + hit_, static_cast<int>(max_)));
  }
  if (ray_count_ < static_cast<int>(rays_.size())) rays_[ray_count_++] = {end, kind};
}

void VoxelMap::end_scan() RT_SAFE {
  if (!inside(camera_)) return;
  // All hits are in by now, and their voxels are marked as updated: the misses pass them by.
  for (int r = 0; r < ray_count_; ++r) {
    const auto& [end, kind] = rays_[r];
    walk(camera_, end, [this](Voxel& voxel) { miss(voxel); });
    Voxel& last = ring_[stored(place(end))];
    if (kind == RayEnd::kOpen) miss(last);
    if (kind == RayEnd::kSurface && solid_behind_ > 0 && last.log_odds > occupied_) {
      const auto mark = [](Voxel& voxel) {
        if (voxel.log_odds == kUnknown) voxel.log_odds = kBehind;
      };
      Eigen::Vector3f beyond = end + (end - camera_).normalized() * solid_behind_;
      if (!inside(beyond)) beyond = clip(end, beyond);
      walk(end, beyond, mark);
      mark(ring_[stored(place(beyond))]);
    }
  }
}

inline void VoxelMap::miss(Voxel& voxel) {
  const std::int16_t lowered = seen(std::max(voxel.log_odds - miss_, static_cast<int>(min_)));
  voxel.log_odds = voxel.scan == scan_ ? voxel.log_odds : lowered;
  voxel.scan = scan_;
}

Eigen::Vector3f VoxelMap::clip(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const {
  const Eigen::Vector3f d = to - from;
  float t = 1.0f;
  for (int a = 0; a < 3; ++a) {
    const float border = d[a] > 0 ? static_cast<float>(config_.size[a]) : 0.0f;
    if (d[a] != 0) t = std::min(t, (border - from[a]) / d[a]);
  }
  Eigen::Vector3f p = from + t * d;
  for (int a = 0; a < 3; ++a) {
    p[a] = std::clamp(p[a], 0.0f, std::nextafter(static_cast<float>(config_.size[a]), 0.0f));
  }
  return p;
}

template <class Visit>
void VoxelMap::walk(const Eigen::Vector3f& from, const Eigen::Vector3f& to, Visit visit) {
  // In whole sub-voxels the parameters at which the ray meets faces compare exactly (over the
  // common denominator of the three axes), so that the walk always ends in the voxel of `to`. Odd
  // sub-voxels: no end lies on a face. With 512 voxels of 128 parts on an axis the products stay
  // below 2^52.
  constexpr std::int64_t kParts = 128, kNever = std::numeric_limits<std::int64_t>::max();
  const int stride[3] = {1, config_.size[0], config_.size[0] * config_.size[1]};
  std::int64_t start[3], length[3], next[3], spacing[3], step[3];
  int faces = 0;
  for (int a = 0; a < 3; ++a) {
    start[a] = 2 * static_cast<int>(from[a] * (kParts / 2)) + 1;
    const std::int64_t difference = 2 * static_cast<int>(to[a] * (kParts / 2)) + 1 - start[a];
    length[a] = std::abs(difference);
    step[a] = difference > 0 ? stride[a] : -stride[a];
  }
  for (int a = 0; a < 3; ++a) {
    const std::int64_t within = start[a] % kParts, to_face = step[a] > 0 ? kParts - within : within;
    const int crossed = static_cast<int>((length[a] + kParts - to_face) / kParts);
    const std::int64_t others = std::max<std::int64_t>(length[(a + 1) % 3], 1) *
                                std::max<std::int64_t>(length[(a + 2) % 3], 1);
    next[a] = crossed > 0 ? to_face * others : kNever;
    spacing[a] = kParts * others;
    faces += crossed;
  }
  // Without branches on the axis: which face comes next is as good as random.
  std::int64_t at = place(from), x = next[0], y = next[1], z = next[2];
  for (; faces > 0; --faces) {
    visit(ring_[stored(static_cast<int>(at))]);
    const std::int64_t nearest = std::min(std::min(x, y), z);
    const std::int64_t on_x = -static_cast<std::int64_t>(x == nearest);
    const std::int64_t on_y = -static_cast<std::int64_t>(y == nearest) & ~on_x;
    const std::int64_t on_z = ~(on_x | on_y);
    x += on_x & spacing[0];
    y += on_y & spacing[1];
    z += on_z & spacing[2];
    at += (on_x & step[0]) | (on_y & step[1]) | (on_z & step[2]);
  }
}

int VoxelMap::solid(std::uint8_t* solid) const RT_SAFE {
  int occupied = 0;
  const auto convert = [&](int first, int last) {
    for (int i = first; i < last; ++i) {
      const std::int16_t value = ring_[i].log_odds;
      occupied += value > occupied_;
      *solid++ = value > occupied_ || value == kBehind;
    }
  };
  convert(turn_, voxels_);
  convert(0, turn_);
  return occupied;
}

}  // namespace wb
