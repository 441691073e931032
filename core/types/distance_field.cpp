#include "core/types/distance_field.hpp"

#include <algorithm>
#include <cmath>

namespace wb {

DistanceField::DistanceField(std::array<int, 3> size, double resolution)
    : size_(size),
      resolution_(resolution),
      values_(static_cast<std::size_t>(size[0]) * size[1] * size[2], static_cast<float>(kNoMap)) {}

double DistanceField::distance(const Eigen::Vector3d& p_W,
                               Eigen::Vector3d* gradient) const noexcept {
  if (empty()) {
    if (gradient) gradient->setZero();
    return kNoMap;
  }
  // Cell coordinates between voxel centres: c = 0 at the first centre, size - 1 at the last.
  const double inverse = 1.0 / resolution_;
  int i[3];
  double f[3];
  double slope[3];  // d(cell coordinate)/d(position): zero where the position was clamped
  for (int a = 0; a < 3; ++a) {
    const double last = size_[a] - 1;
    double c = (p_W[a] - origin_W[a]) * inverse - 0.5;
    slope[a] = inverse;
    if (!(c >= 0.0)) {  // also catches NaN
      c = 0.0;
      slope[a] = 0.0;
    } else if (c >= last) {
      c = last;
      slope[a] = 0.0;
    }
    i[a] = std::min(static_cast<int>(c), size_[a] - 2);
    f[a] = c - i[a];
  }
  const std::size_t dy = size_[0], dz = static_cast<std::size_t>(size_[0]) * size_[1];
  const float* v = values_.data() + index(i[0], i[1], i[2]);
  const double v000 = v[0], v100 = v[1], v010 = v[dy], v110 = v[dy + 1];
  const double v001 = v[dz], v101 = v[dz + 1], v011 = v[dz + dy], v111 = v[dz + dy + 1];
  const double v00 = v000 + f[0] * (v100 - v000), v10 = v010 + f[0] * (v110 - v010);
  const double v01 = v001 + f[0] * (v101 - v001), v11 = v011 + f[0] * (v111 - v011);
  const double v0 = v00 + f[1] * (v10 - v00), v1 = v01 + f[1] * (v11 - v01);
  if (gradient) {
    const double gx0 = (v100 - v000) + f[1] * ((v110 - v010) - (v100 - v000));
    const double gx1 = (v101 - v001) + f[1] * ((v111 - v011) - (v101 - v001));
    *gradient << slope[0] * (gx0 + f[2] * (gx1 - gx0)),
        slope[1] * ((v10 - v00) + f[2] * ((v11 - v01) - (v10 - v00))), slope[2] * (v1 - v0);
  }
  return v0 + f[2] * (v1 - v0);
}

}  // namespace wb
