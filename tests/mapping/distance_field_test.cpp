// DistanceField: interpolation, analytic gradient, clamping at the border.
#include "core/types/distance_field.hpp"

#include <gtest/gtest.h>

#include <random>

namespace wb {
namespace {

constexpr double kResolution = 0.1;

DistanceField random_field() {
  DistanceField field({7, 6, 5}, kResolution);
  field.seq = 1;
  field.origin_W << -0.3, 0.2, -0.1;
  std::mt19937 random(7);
  std::uniform_real_distribution<float> value(-0.2f, 2.0f);
  for (int k = 0; k < 5; ++k) {
    for (int j = 0; j < 6; ++j) {
      for (int i = 0; i < 7; ++i) field.at(i, j, k) = value(random);
    }
  }
  return field;
}

TEST(DistanceField, GradientEqualsFiniteDifferencesInsideCells) {
  const DistanceField field = random_field();
  std::mt19937 random(8);
  std::uniform_int_distribution<int> cell(0, 3);
  std::uniform_real_distribution<double> within(0.05,
                                                0.95);  // off the faces, where the gradient jumps
  constexpr double kStep = 1e-6;
  // The interpolant is linear along each axis: central differences carry rounding only, 1e-16 * 2 /
  // 1e-6, times 100.
  constexpr double kTolerance = 2e-8;
  for (int n = 0; n < 1000; ++n) {
    Eigen::Vector3d p;
    for (int a = 0; a < 3; ++a)
      p[a] = field.origin_W[a] + (0.5 + cell(random) + within(random)) * kResolution;
    Eigen::Vector3d gradient;
    field.distance(p, &gradient);
    for (int a = 0; a < 3; ++a) {
      const Eigen::Vector3d h = kStep * Eigen::Vector3d::Unit(a);
      EXPECT_NEAR(gradient[a], (field.distance(p + h) - field.distance(p - h)) / (2 * kStep),
                  kTolerance);
    }
  }
}

TEST(DistanceField, VoxelCentresYieldTheirValues) {
  const DistanceField field = random_field();
  for (int k = 0; k < 5; ++k) {
    for (int j = 0; j < 6; ++j) {
      for (int i = 0; i < 7; ++i) {
        const Eigen::Vector3d p =
            field.origin_W + kResolution * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5);
        EXPECT_NEAR(field.distance(p), field.at(i, j, k), 1e-12);
      }
    }
  }
}

TEST(DistanceField, OutsideTheGridHoldsTheBorderAndDropsItsSlope) {
  const DistanceField field = random_field();
  const Eigen::Vector3d p = field.origin_W + kResolution * Eigen::Vector3d(3.2, 2.7, 2.4);
  Eigen::Vector3d gradient, outside_gradient;
  Eigen::Vector3d border = p, outside = p;
  border.x() = field.origin_W.x() + 6.5 * kResolution;
  outside.x() = border.x() + 3.0;
  const double value = field.distance(border, &gradient);
  EXPECT_NEAR(field.distance(outside, &outside_gradient), value, 1e-12);
  EXPECT_EQ(outside_gradient.x(), 0.0);
  EXPECT_NEAR(outside_gradient.y(), gradient.y(), 1e-9);
}

TEST(DistanceField, AnswersNoMapBeforeTheFirst) {
  DistanceField field({4, 4, 4}, kResolution);
  Eigen::Vector3d gradient(1, 1, 1);
  EXPECT_EQ(field.distance({0.2, 0.2, 0.2}, &gradient), DistanceField::kNoMap);
  EXPECT_EQ(gradient.norm(), 0.0);
}

}  // namespace
}  // namespace wb
