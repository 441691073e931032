// Exact signed Euclidean distance transform of a solid/free grid, truncated; mapping loop, step
// world. Works on squared voxel distances in 16 bits, one axis at a time: the lower envelope of
// Felzenszwalb and Huttenlocher 2012, where truncation bounds the window of the minimum, so that it
// is taken by brute force in vector registers.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "core/rt/rt_safe.hpp"
#include "core/types/distance_field.hpp"

namespace wb {

class DistanceTransform {
 public:
  static constexpr int kMaxTruncation = 180;  // voxels: twice its square still fits in 16 bits

  // truncation [voxels] in [1, kMaxTruncation].
  DistanceTransform(std::array<int, 3> size, int truncation);

  // `solid`: one byte for each voxel in the field's order, 1 = solid, 0 = free. Writes every value
  // of the field:
  //   free voxel:  (distance to the nearest solid voxel's centre - 1/2 voxel), positive
  //   solid voxel: (1/2 voxel - distance to the nearest free voxel's centre), negative
  // so that the zero set lies on the faces between them. Distances are cut at `truncation` voxels.
  // Nothing is solid or free outside the grid.
  void signed_distance(const std::uint8_t* solid, DistanceField& field) RT_SAFE;

 private:
  // Squared distance [voxel^2], at most truncation^2, to the nearest voxel whose byte equals
  // `source`.
  void squared_distance(const std::uint8_t* solid, std::uint8_t source, std::uint16_t* out) RT_SAFE;

  std::array<int, 3> size_;
  int truncation_;
  std::vector<std::uint16_t> outside_, inside_;  // squared distances
  std::vector<std::uint16_t>
      slab_;  // nz rows of nx, or one row padded by the truncation on both sides
};

}  // namespace wb
