// KeyframeGenerator: the hand keeps its place on the moving part, whatever the joint.
#include "perception/keyframe_generator.hpp"

#include <gtest/gtest.h>

#include <random>

namespace wb {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

// Poses travel as unit quaternions: a few roundings of numbers up to 3.
constexpr double kRounding = 1e-12;

Isometry3d random_pose(std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto draw = [&] { return uniform(random); };
  const double a = draw(), b = draw(), c = draw(), d = draw();
  Isometry3d X = Isometry3d::Identity();
  X.linear() = Eigen::Quaterniond(a, b, c, d).normalized().toRotationMatrix();
  X.translation() << draw(), draw(), draw();
  return X;
}

ObjectPlan random_plan(JointKind kind, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  ObjectPlan plan;
  plan.articulation.kind = kind;
  const Isometry3d axis = random_pose(random);
  Vector3d::Map(plan.articulation.axis.data()) = axis.linear().col(2);
  Vector3d::Map(plan.articulation.axis_origin.data()) = axis.translation();
  plan.articulation.value = 0.1;
  plan.articulation.range = kind == JointKind::kPrismatic ? 0.4 : 1.5;
  plan.X_WG = Pose::from(random_pose(random));
  return plan;
}

TEST(KeyframeGenerator, FirstKeyframeIsTheHandleAtThePresentValueAndTheLastAtTheRange) {
  for (const JointKind kind : {JointKind::kPrismatic, JointKind::kRevolute}) {
    ObjectPlan plan = random_plan(kind, 1);
    const Isometry3d X_WG = plan.X_WG.isometry();
    KeyframeGenerator(X_WG.linear().col(0)).generate(plan);
    EXPECT_EQ(plan.keyframe_count, KeyframeGenerator::kKeyframes);
    EXPECT_TRUE(plan.keyframes[0].isometry().isApprox(X_WG, kRounding));
    EXPECT_EQ(plan.keyframe_value[0], plan.articulation.value);
    EXPECT_NEAR(plan.keyframe_value[plan.keyframe_count - 1], plan.articulation.range, kRounding);
    for (int i = 1; i < plan.keyframe_count; ++i) {
      EXPECT_NEAR(plan.keyframe_value[i] - plan.keyframe_value[i - 1],
                  (plan.articulation.range - plan.articulation.value) / (plan.keyframe_count - 1),
                  kRounding);
    }
  }
}

TEST(KeyframeGenerator, PrismaticKeyframesMoveAlongTheAxisWithoutTurning) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    ObjectPlan plan = random_plan(JointKind::kPrismatic, seed);
    KeyframeGenerator(Vector3d::UnitX()).generate(plan);
    const Vector3d axis = Vector3d::Map(plan.articulation.axis.data());
    for (int i = 0; i < plan.keyframe_count; ++i) {
      const double way = plan.keyframe_value[i] - plan.articulation.value;
      EXPECT_LE((plan.keyframes[i].position() - plan.X_WG.position() - way * axis).norm(),
                kRounding);
      EXPECT_LE(plan.keyframes[i].rotation().angularDistance(plan.keyframes[0].rotation()),
                1e-7);  // of acos near 1
    }
  }
}

TEST(KeyframeGenerator, RevoluteKeyframesKeepTheirPoseOnTheMovingPart) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    ObjectPlan plan = random_plan(JointKind::kRevolute, seed);
    KeyframeGenerator(Vector3d::UnitX()).generate(plan);
    const Vector3d axis = Vector3d::Map(plan.articulation.axis.data());
    const Vector3d origin = Vector3d::Map(plan.articulation.axis_origin.data());
    const Isometry3d first = plan.keyframes[0].isometry();
    for (int i = 0; i < plan.keyframe_count; ++i) {
      const Isometry3d X = plan.keyframes[i].isometry();
      // Distance to the axis and height along it stay: the motion is a rotation about this very
      // axis ...
      const Vector3d a = first.translation() - origin, b = X.translation() - origin;
      EXPECT_NEAR(axis.dot(a), axis.dot(b), kRounding);
      EXPECT_NEAR(axis.cross(a).norm(), axis.cross(b).norm(), kRounding);
      // ... by exactly the change of the joint's value ...
      const Eigen::AngleAxisd turn(Eigen::Matrix3d(X.linear() * first.linear().transpose()));
      const double change = plan.keyframe_value[i] - plan.articulation.value;
      EXPECT_NEAR(turn.angle(), change, 1e-9);
      EXPECT_TRUE(change < 0.01 || (turn.axis() - axis).norm() <= 1e-9);
      // ... so that a point of the moving part is always at the same place in the hand.
      const Vector3d part = origin + a + Vector3d(0.1, -0.2, 0.3);
      const Vector3d moved = origin + Eigen::AngleAxisd(change, axis) * (part - origin);
      EXPECT_LE((X.inverse() * moved - first.inverse() * part).norm(), kRounding);
    }
  }
}

TEST(KeyframeGenerator, RollIsTheOneNearerToTheAskedDirection) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    ObjectPlan plan = random_plan(JointKind::kPrismatic, seed);
    const Isometry3d X_WG = plan.X_WG.isometry();
    for (const double sign : {1.0, -1.0}) {
      const Vector3d wish = sign * X_WG.linear().col(0) + 0.5 * X_WG.linear().col(2);
      KeyframeGenerator(wish).generate(plan);
      const Isometry3d X_WE = plan.keyframes[0].isometry();
      EXPECT_LE((X_WE.linear().col(0) - sign * X_WG.linear().col(0)).norm(), kRounding);
      EXPECT_LE((X_WE.linear().col(2) - X_WG.linear().col(2)).norm(), kRounding)
          << "approaches into the front";
      EXPECT_LE((X_WE.translation() - X_WG.translation()).norm(), kRounding);
    }
  }
}

}  // namespace
}  // namespace wb
