// Occupancy of the space around the robot: log-odds on a dense grid that rolls with the base
// (toroidal index: moving touches only the columns that enter). Mapping loop, step world. Frame W,
// axis-aligned; C a camera's optical frame. Within one scan a voxel changes at most once, and a hit
// by any ray beats every miss: thin things fill few pixels. Source: Amanatides and Woo 1987
// (traversal); Moravec and Elfes 1985 (log-odds).
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "core/rt/rt_safe.hpp"

namespace wb {

struct VoxelMapConfig {
  std::array<int, 3> size{};  // voxels
  double resolution_m = 0.1;
  double bottom_m = 0;  // z of the window's lower face in W
  double recentre_m =
      0;  // the window moves once the base is further than this from its centre, in x or y
  double floor_height_m = 0;  // surfaces below it are floor: rays to them clear and never occupy
  double solid_behind_m =
      0;  // unknown space up to this far behind an occupied voxel, along the ray, is solid
  double log_odds_hit = 0, log_odds_miss = 0;  // both positive
  double log_odds_min = 0, log_odds_max = 0;
  double log_odds_occupied = 0;  // occupied: above this
  int rays_per_scan = 0;         // largest number of rays between begin_scan and end_scan
};

enum class RayEnd : std::uint8_t {
  kSurface,  // a return: its voxel is hit
  kOpen,     // free up to the end, the end's voxel included (floor, or the ray goes on)
  kBlocked,  // free before the end's voxel, which says nothing of the world (the robot's own body)
};

class VoxelMap {
 public:
  explicit VoxelMap(const VoxelMapConfig& config);

  // Moves the window in whole voxels when the base has left its middle; what enters is unknown.
  void follow(const Eigen::Vector2d& p_WB) RT_SAFE;
  void clear() RT_SAFE;

  // One exposure: begin, add every ray (its end in C [m], finite), end. Of rays that end in the
  // same voxel only the first is traced. Rays that leave the window clear up to its border. A
  // camera outside the window clears nothing.
  void begin_scan(const Eigen::Isometry3d& X_WC) RT_SAFE;
  void add(const Eigen::Vector3f& p_C, RayEnd kind) RT_SAFE;
  void end_scan() RT_SAFE;

  // Writes 1 for every solid voxel (occupied, or unknown space behind a surface) and 0 for all
  // others, x fastest, from the window's lower corner. Returns the number of occupied voxels.
  // `solid` holds size() bytes.
  int solid(std::uint8_t* solid) const RT_SAFE;

  int size() const { return voxels_; }
  Eigen::Vector3d origin_W() const;                          // lower corner of the window [m]
  float log_odds(const Eigen::Vector3d& p_W) const RT_SAFE;  // 0: unknown or outside the window

 private:
  struct Voxel {
    std::int16_t log_odds = 0;  // thousandths; kUnknown and kBehind are special
    std::uint16_t scan = 0;     // the last that changed it; 0: none
  };
  struct Ray {
    Eigen::Vector3f end;  // voxels from the window's lower corner
    RayEnd kind;
  };

  bool inside(const Eigen::Vector3f& p) const {
    return p.x() >= 0 && p.y() >= 0 && p.z() >= 0 && p.x() < config_.size[0] &&
           p.y() < config_.size[1] && p.z() < config_.size[2];
  }
  // Place in window order (x fastest) of the voxel that holds p, in voxels from the lower corner; p
  // must be inside.
  int place(const Eigen::Vector3f& p) const {
    const auto [nx, ny, nz] = config_.size;
    return static_cast<int>(p.x()) + nx * (static_cast<int>(p.y()) + ny * static_cast<int>(p.z()));
  }
  // Storage is one ring in window order: a move by (i, j) voxels turns it by i + j * nx, and
  // whatever leaves makes room for what enters.
  int stored(int place) const {
    const int i = place + turn_;
    return i < voxels_ ? i : i - voxels_;
  }
  // The last point of the segment within the window.
  Eigen::Vector3f clip(const Eigen::Vector3f& from, const Eigen::Vector3f& to) const;
  // Calls visit(voxel) for the voxels from `from` (included) to `to` (not included); both inside
  // the window.
  template <class Visit>
  void walk(const Eigen::Vector3f& from, const Eigen::Vector3f& to, Visit visit);
  void miss(Voxel& voxel);

  VoxelMapConfig config_;
  std::int16_t hit_, miss_, min_, max_, occupied_;  // thousandths
  float floor_, solid_behind_;                      // voxels
  int recentre_;                                    // voxels

  std::array<int, 2> corner_;  // x, y of the window's lower corner, in voxels from W's origin
  int voxels_;
  int turn_ = 0;  // where the window's first voxel is stored
  std::vector<Voxel> ring_;
  std::vector<std::uint16_t>
      ended_;  // the last scan in which a ray that is no hit ended in the voxel, as stored
  std::uint16_t scan_ = 0;

  Eigen::Matrix3f rotation_;  // C to window, voxels per metre
  Eigen::Vector3f camera_;    // voxels
  std::vector<Ray> rays_;     // size fixed; the first ray_count_ are of this scan
  int ray_count_ = 0;
};

}  // namespace wb
