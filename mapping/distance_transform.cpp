#include "mapping/distance_transform.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace wb {
namespace {

// out[i] = min(out[i], in[i] + c): the inner loop of the minimum, eight or sixteen voxels to an
// instruction.
inline void lower(std::uint16_t* __restrict out, const std::uint16_t* __restrict in,
                  std::uint16_t c, int n) {
  for (int i = 0; i < n; ++i) {
    const std::uint16_t candidate = static_cast<std::uint16_t>(in[i] + c);
    out[i] = candidate < out[i] ? candidate : out[i];
  }
}

}  // namespace

DistanceTransform::DistanceTransform(std::array<int, 3> size, int truncation)
    : size_(size),
      truncation_(truncation),
      outside_(static_cast<std::size_t>(size[0]) * size[1] * size[2]),
      inside_(outside_.size()),
      slab_(
          std::max(static_cast<std::size_t>(size[0]) * size[2],
                   static_cast<std::size_t>(size[0]) + 2 * static_cast<std::size_t>(truncation))) {}

void DistanceTransform::squared_distance(const std::uint8_t* solid, std::uint8_t source,
                                         std::uint16_t* out) RT_SAFE {
  const auto [nx, ny, nz] = size_;
  const std::size_t plane = static_cast<std::size_t>(nx) * ny;
  const auto limit = static_cast<std::uint16_t>(truncation_);
  const auto limit_squared = static_cast<std::uint16_t>(truncation_ * truncation_);

  // Along y: count voxels since the last source, forward and back, then square.
  for (int k = 0; k < nz; ++k) {
    const std::uint8_t* s = solid + k * plane;
    std::uint16_t* d = out + k * plane;
    for (int i = 0; i < nx; ++i) d[i] = s[i] == source ? 0 : limit;
    for (int j = 1; j < ny; ++j) {
      const std::uint8_t* s_row = s + static_cast<std::size_t>(j) * nx;
      std::uint16_t* row = d + static_cast<std::size_t>(j) * nx;
      const std::uint16_t* before = row - nx;
      for (int i = 0; i < nx; ++i) {
        const auto next = static_cast<std::uint16_t>(before[i] + 1);
        row[i] = s_row[i] == source ? 0 : (next < limit ? next : limit);
      }
    }
    for (int j = ny - 2; j >= 0; --j) {
      std::uint16_t* row = d + static_cast<std::size_t>(j) * nx;
      lower(row, row + nx, 1, nx);
    }
    for (std::size_t v = 0; v < plane; ++v) d[v] = static_cast<std::uint16_t>(d[v] * d[v]);
  }

  // Along z: every output row is the minimum over the rows closer than the truncation.
  for (int j = 0; j < ny; ++j) {
    std::uint16_t* column = out + static_cast<std::size_t>(j) * nx;
    for (int k = 0; k < nz; ++k) {
      std::copy_n(column + k * plane, nx, slab_.data() + static_cast<std::size_t>(k) * nx);
    }
    for (int k = 0; k < nz; ++k) {
      const int first = std::max(0, k - truncation_ + 1),
                last = std::min(nz - 1, k + truncation_ - 1);
      for (int other = first; other <= last; ++other) {
        const auto squared = static_cast<std::uint16_t>((other - k) * (other - k));
        lower(column + k * plane, slab_.data() + static_cast<std::size_t>(other) * nx, squared, nx);
      }
    }
  }

  // Along x: the same within a row; the padding holds no source.
  std::uint16_t* row = slab_.data() + truncation_;
  std::fill_n(slab_.data(), nx + 2 * truncation_, limit_squared);
  for (std::size_t r = 0; r < static_cast<std::size_t>(ny) * nz; ++r) {
    std::uint16_t* d = out + r * nx;
    std::copy_n(d, nx, row);
    for (int shift = 1; shift < truncation_; ++shift) {
      const auto squared = static_cast<std::uint16_t>(shift * shift);
      lower(d, row - shift, squared, nx);
      lower(d, row + shift, squared, nx);
    }
  }
}

void DistanceTransform::signed_distance(const std::uint8_t* solid, DistanceField& field) RT_SAFE {
  squared_distance(solid, 1, outside_.data());
  squared_distance(solid, 0, inside_.data());
  const auto resolution = static_cast<float>(field.resolution());
  float* values = field.data();
  for (std::size_t v = 0; v < outside_.size(); ++v) {
    // One of the two is zero.
    const float d = std::sqrt(static_cast<float>(outside_[v] + inside_[v])) - 0.5f;
    values[v] = (solid[v] ? -d : d) * resolution;
  }
}

}  // namespace wb
