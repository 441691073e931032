// Depth and geom of every pixel of a pinhole camera, exactly, for planes, boxes, capsules,
// cylinders and ellipsoids. render() is a step: no allocation. All rays share the camera's centre,
// so each solid is put into the camera's frame once and then tested against rows of eight pixels,
// front to back, only where its projection lies and nothing nearer does. Frames: S world, C camera
// (optical: z forward, x right, y down). Metres; depth is along z.
#pragma once
#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "core/types/depth_frame.hpp"

namespace wb::sim {

// Where all geoms of a model were at one instant.
struct GeomPoses {
  TimeNs t_ns = 0;
  std::vector<double> position;  // 3 for each geom
  std::vector<double> rotation;  // 9 for each geom, row-major

  explicit GeomPoses(const mjModel& model) : position(3 * model.ngeom), rotation(9 * model.ngeom) {}
  void take(const mjData& data, TimeNs t_ns) noexcept;
};

class RayCaster {
 public:
  // For images of at most this many pixels.
  RayCaster(const mjModel& model, int max_width, int max_height);

  void render(const GeomPoses& poses, const Eigen::Isometry3d& X_SC,
              const CameraIntrinsics& camera) noexcept;
  // The last image, row by row: depth, infinite where there is nothing; geom, -1 where there is
  // nothing.
  const float* depth_row(int v) const noexcept {
    return depth_.data() + static_cast<std::size_t>(v) * stride_;
  }
  const std::int32_t* geom_row(int v) const noexcept {
    return geom_.data() + static_cast<std::size_t>(v) * stride_;
  }

 private:
  struct Solid {
    int type = 0;          // mjtGeom
    Eigen::Vector3d half;  // half extents of the box about it
    double radius = 0, half_length = 0;
  };
  struct Candidate {
    float near = 0;  // smallest depth of the box about it
    std::int32_t geom = 0;
    int u_min = 0, u_max = 0, v_min = 0, v_max = 0;
  };
  struct Local;  // the camera's rays in a solid's frame

  bool project(const Eigen::Isometry3d& X_CG, const Eigen::Vector3d& half, Candidate& candidate,
               bool rows) noexcept;
  void add_edge(const Eigen::Vector3d& a, const Eigen::Vector3d& b, Candidate& candidate,
                bool rows) noexcept;
  template <class Hit>
  void fill(const Candidate& candidate, const Local& local, const Hit& hit) noexcept;
  void draw(const Candidate& candidate, const Eigen::Isometry3d& X_CG) noexcept;

  std::vector<Solid> solids_;
  std::vector<Candidate> candidates_;
  std::vector<Eigen::Isometry3d> X_CG_;
  CameraIntrinsics camera_;
  int stride_ = 0;
  std::vector<float> column_x_;  // x of the ray at depth 1, for each column
  std::vector<float> depth_;
  std::vector<std::int32_t> geom_;
  std::vector<float> block_far_;          // largest depth in each block of a row
  std::vector<float> row_min_, row_max_;  // columns [pixels] that a projection covers
};

}  // namespace wb::sim
