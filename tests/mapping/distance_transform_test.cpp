// The signed distance transform against brute force over all pairs of voxels.
#include "mapping/distance_transform.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <tuple>
#include <vector>

namespace wb {
namespace {

constexpr double kResolution = 0.1;
// One rounding each of square root, difference and product, on values up to 10 voxels.
constexpr double kRounding = 1e-5;

double brute_force(const std::vector<std::uint8_t>& solid, const DistanceField& field,
                   int truncation, int i, int j, int k) {
  const auto [nx, ny, nz] = field.size();
  const std::uint8_t own = solid[field.index(i, j, k)];
  int best = truncation * truncation;
  for (int c = 0; c < nz; ++c) {
    for (int b = 0; b < ny; ++b) {
      for (int a = 0; a < nx; ++a) {
        if (solid[field.index(a, b, c)] != own) {
          best = std::min(best, (a - i) * (a - i) + (b - j) * (b - j) + (c - k) * (c - k));
        }
      }
    }
  }
  const double d = (std::sqrt(static_cast<double>(best)) - 0.5) * kResolution;
  return own ? -d : d;
}

class OnRandomGrids : public testing::TestWithParam<std::tuple<std::array<int, 3>, double, int>> {};

TEST_P(OnRandomGrids, EveryVoxelEqualsBruteForce) {
  const auto [size, density, truncation] = GetParam();
  DistanceField field(size, kResolution);
  std::vector<std::uint8_t> solid(static_cast<std::size_t>(size[0]) * size[1] * size[2]);
  std::mt19937 random(42);
  std::bernoulli_distribution coin(density);
  for (auto& s : solid) s = coin(random);
  DistanceTransform transform(size, truncation);
  transform.signed_distance(solid.data(), field);
  transform.signed_distance(solid.data(), field);  // scratch of an earlier call leaves no trace
  for (int k = 0; k < size[2]; ++k) {
    for (int j = 0; j < size[1]; ++j) {
      for (int i = 0; i < size[0]; ++i) {
        ASSERT_NEAR(field.at(i, j, k), brute_force(solid, field, truncation, i, j, k), kRounding)
            << i << " " << j << " " << k;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(DistanceTransform, OnRandomGrids,
                         testing::Combine(testing::Values(std::array{17, 9, 13},
                                                          std::array{8, 23, 11},
                                                          std::array{33, 4, 5}),
                                          testing::Values(0.0, 0.001, 0.02, 0.3, 0.98, 1.0),
                                          testing::Values(1, 5, 20, 180)));

TEST(DistanceTransform, ZeroSetOfAHalfSpaceLiesOnTheFace) {
  const std::array<int, 3> size{12, 6, 6};
  DistanceField field(size, kResolution);
  field.seq = 1;
  std::vector<std::uint8_t> solid(12 * 6 * 6);
  for (std::size_t v = 0; v < solid.size(); ++v) solid[v] = v % 12 < 5;
  DistanceTransform(size, 20).signed_distance(solid.data(), field);
  Eigen::Vector3d gradient;
  for (double x = 0.06; x < 1.14; x += 0.013) {
    EXPECT_NEAR(field.distance({x, 0.3, 0.3}, &gradient), x - 0.5, kRounding);
    EXPECT_NEAR((gradient - Eigen::Vector3d::UnitX()).norm(), 0.0,
                1e-4);  // values' rounding over a voxel
  }
}

}  // namespace
}  // namespace wb
