// Signed distance to the nearest obstacle on a regular grid in W, with trilinear value and analytic
// gradient. Made by mapping (15 Hz), pinned by MPC for a whole solve. Storage is allocated once, at
// setup. Source: Felzenszwalb and Huttenlocher 2012 (transform); Mittal et al. 2022, Sec. IV (use
// in the MPC).
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "core/types/time.hpp"

namespace wb {

class DistanceField {
 public:
  DistanceField() = default;
  // Allocates nx * ny * nz values; resolution [m].
  DistanceField(std::array<int, 3> size, double resolution);

  // Distance [m] at p_W and, if asked, its gradient. Positive outside obstacles. Outside the grid
  // the value is that of the closest point of the grid (positions are clamped) and the gradient's
  // clamped components are zero. An empty field (before the first map) answers kNoMap everywhere
  // with zero gradient.
  double distance(const Eigen::Vector3d& p_W, Eigen::Vector3d* gradient = nullptr) const noexcept;

  bool empty() const { return values_.empty() || seq == 0; }
  const std::array<int, 3>& size() const { return size_; }
  double resolution() const { return resolution_; }
  // Value of voxel (i, j, k): the signed distance at its centre, origin + (i + 0.5, j + 0.5, k +
  // 0.5) * resolution.
  float& at(int i, int j, int k) { return values_[index(i, j, k)]; }
  float at(int i, int j, int k) const { return values_[index(i, j, k)]; }
  float* data() { return values_.data(); }
  const float* data() const { return values_.data(); }
  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * size_[1] + j) * size_[0] + i;
  }

  static constexpr double kNoMap = 10.0;  // m

  std::uint64_t seq = 0;
  TimeNs t_ns = 0;                    // stamp of the newest frame in it
  Eigen::Vector3d origin_W{0, 0, 0};  // lower corner of voxel (0, 0, 0)

 private:
  std::array<int, 3> size_{0, 0, 0};
  double resolution_ = 0.1;
  std::vector<float> values_;
};

}  // namespace wb
