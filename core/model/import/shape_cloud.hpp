// A body's collision shapes as points, and how good a fit to them is. Setup world; deterministic.
// SI units, the body's frame.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "core/model/import/shape_fitting.hpp"

namespace wb {

// A body's shapes as points: on the surface, and inside on a grid.
struct ShapeCloud {
  std::vector<Solid> solids;  // meshes thinned
  std::vector<Eigen::Vector3d> surface, inside;
  double spacing = 0;

  explicit ShapeCloud(const std::vector<Solid>& body);
  // Distance of a point from the shapes, not negative; of meshes to the nearest sample.
  double beyond(const Eigen::Vector3d& p) const;
};

// Points spread evenly over a unit sphere.
const std::vector<Eigen::Vector3d>& unit_directions();

// Coverage of a body's surface by a set that a point is at the signed `distance` from.
template <typename Distance>
void measure_coverage(const std::vector<Solid>& body, double spacing, Distance distance,
                      FitQuality& quality) {
  std::size_t samples = 0, inside = 0;
  for (const Solid& s : body) {
    for (const Eigen::Vector3d& p : s.surface(spacing)) {
      const double out = distance(p);
      ++samples;
      inside += out <= 1e-9;
      quality.sticks_out_m = std::max(quality.sticks_out_m, out);
    }
  }
  quality.coverage = static_cast<double>(inside) / static_cast<double>(samples);
}

}  // namespace wb
