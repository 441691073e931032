// Fitted capsules and spheres against analytic shapes and Mabi-Mobile's: coverage by points that
// the fit never saw (drawn at random on the true surfaces), overhang by known geometry.
#include "core/model/import/shape_fitting.hpp"

#include <gtest/gtest.h>

#include <map>
#include <numbers>
#include <random>

#include "tests/core/model/primitives.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;

Solid solid(Solid::Kind kind, const Vector3d& half) {
  Solid s;
  s.kind = kind;
  s.half = half;
  s.X_LS.linear() = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).matrix();
  s.X_LS.translation() = Vector3d(0.1, -0.2, 0.3);
  return s;
}

// A point on the true surface of a primitive, independent of Solid::surface.
Vector3d random_surface_point(const Solid& s, std::mt19937& random) {
  std::uniform_real_distribution<double> u(-1, 1);
  const double a = std::numbers::pi * u(random);
  Vector3d p;
  if (s.kind == Solid::Kind::kSphere) {
    p = s.half.x() * Vector3d(u(random), u(random), u(random)).normalized();
  } else if (s.kind == Solid::Kind::kBox) {
    const int face = static_cast<int>(random() % 3);
    p = Vector3d(u(random), u(random), u(random)).cwiseProduct(s.half);
    p[face] = u(random) < 0 ? -s.half[face] : s.half[face];
  } else {
    const bool side = u(random) < 0.3;
    const double r = side ? s.half.x() : s.half.x() * std::sqrt(std::abs(u(random)));
    p = Vector3d(r * std::cos(a), r * std::sin(a),
                 side ? u(random) * s.half.z() : std::copysign(s.half.z(), u(random)));
  }
  return s.X_LS * p;
}

double outside(const CapsuleFit& fit, const Vector3d& p) {
  double nearest = 1e9;
  for (const FittedCapsule& c : fit.capsules) nearest = std::min(nearest, c.distance(p));
  return nearest;
}
double outside(const SphereFit& fit, const Vector3d& p) {
  double nearest = 1e9;
  for (const FittedSphere& s : fit.spheres)
    nearest = std::min(nearest, (p - s.centre).norm() - s.radius);
  return nearest;
}

struct Shape {
  const char* name;
  Solid::Kind kind;
  Vector3d half;
};
const Shape kShapes[] = {
    {"tube", Solid::Kind::kCylinder, {0.05, 0.05, 0.3}},
    {"disc", Solid::Kind::kCylinder, {0.2, 0.2, 0.03}},
    {"ball", Solid::Kind::kSphere, {0.15, 0.15, 0.15}},
    {"cube", Solid::Kind::kBox, {0.1, 0.1, 0.1}},
    {"plate", Solid::Kind::kBox, {0.3, 0.2, 0.02}},
};

TEST(ShapeFitting, CapsulesHoldEveryPointOfTheSurface) {
  std::mt19937 random(3);
  for (const Shape& shape : kShapes) {
    const Solid s = solid(shape.kind, shape.half);
    const CapsuleFit fit = fit_capsules({s}, 3, 0.02);
    EXPECT_LE(fit.capsules.size(), 3u) << shape.name;
    EXPECT_EQ(fit.quality.coverage, 1.0) << shape.name;
    for (int i = 0; i < 3000; ++i)
      ASSERT_LE(outside(fit, random_surface_point(s, random)), 0) << shape.name;
  }
}

TEST(ShapeFitting, ALongTubeIsOneCapsuleAlongItsAxis) {
  const Solid s = solid(Solid::Kind::kCylinder, {0.05, 0.05, 0.3});
  const CapsuleFit fit = fit_capsules({s}, 3, 0.06);
  ASSERT_EQ(fit.capsules.size(), 1u);
  const FittedCapsule& c = fit.capsules[0];
  EXPECT_GT(std::abs((c.p1 - c.p0).normalized().dot(s.X_LS.linear().col(2))), 0.999);
  EXPECT_LT(c.radius, 1.2 * 0.05);
  EXPECT_LT(fit.quality.overhang_m, 0.055);
}

TEST(ShapeFitting, ABallStaysABallOfItsRadius) {
  const CapsuleFit fit = fit_capsules({solid(Solid::Kind::kSphere, {0.15, 0.15, 0.15})}, 3, 0.02);
  ASSERT_EQ(fit.capsules.size(), 1u);
  EXPECT_NEAR(fit.capsules[0].radius, 0.15, 0.01);
  EXPECT_NEAR((0.5 * (fit.capsules[0].p0 + fit.capsules[0].p1) - Vector3d(0.1, -0.2, 0.3)).norm(),
              0, 0.005);
}

TEST(ShapeFitting, SpheresCoverWithinTwoMillimetresAndTheirBudget) {
  std::mt19937 random(4);
  std::vector<std::vector<Solid>> bodies;
  for (const Shape& shape : kShapes) bodies.push_back({solid(shape.kind, shape.half)});
  const std::vector<SphereFit> fits = fit_spheres(bodies, 30, 0.04);
  std::size_t total = 0, largest = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    total += fits[b].spheres.size();
    largest = std::max(largest, fits[b].spheres.size());
    for (int i = 0; i < 2000; ++i)
      ASSERT_LE(outside(fits[b], random_surface_point(bodies[b][0], random)), 0.002)
          << kShapes[b].name;
  }
  EXPECT_LE(total, 30u);
  EXPECT_EQ(fits[4].spheres.size(), largest) << "the plate is the largest";
}

TEST(ShapeFitting, AMeshIsHeldByCapsulesThatHoldItsCorners) {
  Solid s;
  s.kind = Solid::Kind::kMesh;
  s.mesh = solid(Solid::Kind::kBox, {0.3, 0.1, 0.05}).enclosing(1e9);
  const CapsuleFit fit = fit_capsules({s}, 3, 0.03);
  const Solid box = solid(Solid::Kind::kBox, {0.3, 0.1, 0.05});
  std::mt19937 random(5);
  for (int i = 0; i < 3000; ++i) ASSERT_LE(outside(fit, random_surface_point(box, random)), 0);
  // Half the plate's width and thickness across, no more than a third beyond.
  EXPECT_LT(fit.quality.overhang_m, 0.1);
}

TEST(ShapeFitting, AMeshKnowsItsInsideAndItsDistance) {
  Solid mesh;
  mesh.kind = Solid::Kind::kMesh;
  const Solid box = solid(Solid::Kind::kBox, {0.3, 0.1, 0.05});
  mesh.mesh = box.enclosing(0.1);
  std::mt19937 random(6);
  std::uniform_real_distribution<double> u(-0.5, 0.5);
  for (int i = 0; i < 500; ++i) {
    const Vector3d p(u(random), u(random), u(random));
    EXPECT_NEAR(mesh.distance(p), box.distance(p), 1e-9);
  }
  EXPECT_NEAR(mesh.volume(), 8 * 0.3 * 0.1 * 0.05, 1e-9);
}

TEST(ShapeFitting, MabiMobilesLinksAreCoveredAndTheSecondFitIsTheSame) {
  const auto urdf = read_urdf(WB_SOURCE_DIR "/config/robots/mabi_mobile/robot.urdf");
  std::map<std::string, std::vector<test::Primitive>> links;
  for (const test::Primitive& p : test::primitives_of(*urdf)) links[p.link].push_back(p);
  for (const char* name : {"ARM", "FOREARM", "hand"}) {
    std::vector<Solid> body;
    for (const test::Primitive& p : links[name]) {
      Solid s;
      s.kind = static_cast<Solid::Kind>(p.kind);
      s.half = p.half;
      s.X_LS = p.X_LP;
      body.push_back(s);
    }
    const CapsuleFit fit = fit_capsules(body, 3, 0.04), again = fit_capsules(body, 3, 0.04);
    ASSERT_EQ(fit.capsules.size(), again.capsules.size());
    for (std::size_t i = 0; i < fit.capsules.size(); ++i) {
      EXPECT_EQ(fit.capsules[i].p0, again.capsules[i].p0);
      EXPECT_EQ(fit.capsules[i].radius, again.capsules[i].radius);
    }
    for (const test::Primitive& p : links[name]) {
      for (const Vector3d& q : p.surface(0.013)) ASSERT_LE(outside(fit, q), 0) << name;
    }
    EXPECT_LT(fit.quality.overhang_m, 0.09) << name;
  }
}

}  // namespace
}  // namespace wb
