// Depth frames and robot poses in, distance field out. Mapping loop, 15 Hz, step world: update()
// neither allocates nor reads a clock. Frames: W odometry, B base, C camera (optical).
// Source: Mittal et al. 2022, Sec. IV; Felzenszwalb and Huttenlocher 2012 (transform); Amanatides
// and Woo 1987 (grid traversal).
#pragma once
#include <memory>
#include <span>

#include "core/model/robot_model.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/depth_frame.hpp"
#include "core/types/distance_field.hpp"
#include "core/types/robot_state.hpp"

namespace wb {

// What an update did; fixed size, part of the mapping step's record.
struct MapReport {
  int frames = 0;               // integrated
  int frames_without_pose = 0;  // refused: older than the history, over 5 ms ahead, no such camera
  int pixels_on_robot = 0;      // left out by the robot filter
  int occupied = 0;             // voxels after the update
};

// What a consumer can rely on, with h the voxel size and surfaces seen without noise:
//
// Distance. At a voxel's centre in seen free space the error is between -(sqrt(3) + 1)/2 h and
// +(sqrt(3) - 1)/2 h (-14 and +4 cm for 10 cm), since a voxel is solid wherever in it the surface
// lies. A wall along an axis is never too far, and half a voxel too near on average. Between
// centres add the interpolation's sqrt(3)/2 h; at the edge of an object seen from one side, what
// counts as solid behind it (below). No value exceeds the truncation less h/2.
//
// Unknown space is free: a robot in a fresh map can move, and what its cameras never faced (the
// floor at its feet, the inside of a cupboard) does not hold it. It must look where it drives. One
// exception: unknown space right behind a surface, along the ray that saw it, is solid to a depth
// of solid_behind_m until it is seen to be free. A shell of one voxel would push whatever crossed
// its middle further in; this way it is pushed out to the side that was seen.
//
// The floor is no obstacle, nor is the robot: pixels on its own (padded) bodies only clear the
// space before them. A new surface is in the field after two frames that saw it, a departed one out
// of it after at most four that saw beyond; what stays out of sight stays as it is.
class Mapper {
 public:
  // Reads mapping.yaml in the robot's folder. Throws config::ConfigError.
  explicit Mapper(std::shared_ptr<const RobotModel> model);
  ~Mapper();

  // Remembers where the robot was; call in order of time.
  void push_state(const RobotState& state) RT_SAFE;
  // Integrates the frames (poses interpolated at their stamps), rolls the window to the robot's
  // base, and writes the field. `field` was made by make_field(). The field's seq is set by the
  // caller's buffer, t_ns and origin_W here.
  MapReport update(std::span<const DepthFrame* const> frames, DistanceField& field) RT_SAFE;
  DistanceField make_field() const;  // allocated at the configured size; setup only
  // Forgets everything seen; where the robot was stays known.
  void reset() RT_SAFE;

  // State of the voxel that holds p_W: log-odds; 0 = unknown or outside the window. For tests and
  // views.
  float log_odds(const Eigen::Vector3d& p_W) const RT_SAFE;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace wb
