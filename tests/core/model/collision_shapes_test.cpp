// robot.yaml's spheres and capsules against the URDF's collision primitives, both sampled on their
// surfaces, in W.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>

#include "core/model/robot_model.hpp"
#include "tests/core/model/primitives.hpp"
#include "tests/core/model/robots.hpp"

namespace wb {
namespace {

constexpr double kSpacing_m = 0.01;
// Only the floor is lower than the chassis' underside, and the floor is no obstacle.
constexpr double kUnderside_m = 0.05;
// Bodies cover for each other where they overlap, so several postures are looked at.
constexpr int kPostures = 4;

class CollisionShapesOf : public ::testing::TestWithParam<std::string> {
 protected:
  const RobotModel model{test::robot(GetParam())};
};
INSTANTIATE_TEST_SUITE_P(Robots, CollisionShapesOf, ::testing::ValuesIn(test::robot_names()),
                         [](const auto& info) { return info.param; });

// A primitive where it may be in W: a finger's at both ends of its stroke.
struct Placed {
  test::Primitive primitive;
  Eigen::Isometry3d X_WF;
};

std::vector<Placed> place(const RobotModel& robot, const RobotModel::Data& data) {
  const urdf::ModelInterfaceSharedPtr urdf = read_urdf(robot.config().urdf);
  std::vector<Placed> out;
  for (const test::Primitive& p : test::primitives_of(*urdf)) {
    const Eigen::Isometry3d X_WF = robot.X_WF(robot.frame(p.link), data);
    out.push_back({p, X_WF});
    const urdf::JointConstSharedPtr joint = urdf->getLink(p.link)->parent_joint;
    const std::vector<std::string>& fingers = robot.config().fingers;
    if (joint && std::count(fingers.begin(), fingers.end(), joint->name) > 0) {
      const Eigen::Vector3d stroke = joint->limits->upper * to_eigen(joint->axis);
      out.push_back({p, X_WF * Eigen::Translation3d(stroke)});
    }
  }
  return out;
}

double to_spheres(const RobotModel& robot, const RobotModel::Data& data,
                  const Eigen::Vector3d& p_W) {
  double nearest = 1e9;
  for (const Sphere& s : robot.spheres()) {
    nearest = std::min(nearest, (p_W - data.X_WL[s.body] * s.centre).norm() - s.radius);
  }
  return nearest;
}

double to_capsules(const RobotModel& robot, const RobotModel::Data& data,
                   const Eigen::Vector3d& p_W) {
  double nearest = 1e9;
  for (const Capsule& c : robot.capsules()) {
    const Eigen::Vector3d p0 = data.X_WL[c.body] * c.p0, d = data.X_WL[c.body] * c.p1 - p0;
    const double s = std::clamp((p_W - p0).dot(d) / std::max(d.squaredNorm(), 1e-12), 0.0, 1.0);
    nearest = std::min(nearest, (p_W - p0 - s * d).norm() - c.radius);
  }
  return nearest;
}

// No point of a primitive's surface sticks out of the union by more than the tolerance.
void expect_cover(const RobotModel& robot,
                  double (*distance)(const RobotModel&, const RobotModel::Data&,
                                     const Eigen::Vector3d&),
                  double tolerance_m) {
  std::mt19937 random(1);
  for (int k = 0; k < kPostures; ++k) {
    RobotModel::Data data;
    StateVector x = test::random_state(robot, random);
    x.head(robot.base_dof()).setZero();
    robot.forward_kinematics(x.data(), data);
    for (const Placed& placed : place(robot, data)) {
      double out = -1e9;
      for (const Eigen::Vector3d& p_F : placed.primitive.surface(kSpacing_m)) {
        const Eigen::Vector3d p_W = placed.X_WF * p_F;
        if (placed.primitive.link == "base" || placed.primitive.link.starts_with("wheel")) {
          if (p_W.z() < kUnderside_m) continue;
        }
        out = std::max(out, distance(robot, data, p_W));
      }
      EXPECT_LE(out, tolerance_m) << placed.primitive.name;
    }
  }
}

// A quarter of the map's voxel (0.1 m): the field is no truer than that.
TEST_P(CollisionShapesOf, SpheresCoverThePrimitivesWithin25mm) {
  expect_cover(model, to_spheres, 0.025);
}

// Half of the distance that the MPC keeps between a pair (0.05 m).
TEST_P(CollisionShapesOf, CapsulesCoverThePrimitivesWithin25mm) {
  expect_cover(model, to_capsules, 0.025);
}

TEST(CollisionShapes, SpheresOfMabiMobileOverhangAtMost40mmBeforeTheChassisAndAtTheHand) {
  const RobotModel robot(test::mabi_mobile());
  constexpr double kChassisFront_m = 0.25;
  RobotModel::Data data;
  const StateVector x = StateVector::Zero(robot.nx());
  robot.forward_kinematics(x.data(), data);
  const std::vector<Placed> primitives = place(robot, data);
  Jacobian J;
  robot.frame_jacobian(robot.end_effector(), data, J);
  for (const Sphere& s : robot.spheres()) {
    if (s.body != 0 && s.body != robot.joints())
      continue;  // the base, and the hand behind the last joint
    test::Primitive ball;
    ball.kind = test::Primitive::Kind::kSphere;
    ball.X_LP = Eigen::Translation3d(s.centre);
    ball.half.setConstant(s.radius);
    for (const Eigen::Vector3d& p_L : ball.surface(kSpacing_m)) {
      if (s.body == 0 && (p_L.x() < kChassisFront_m || p_L.z() < kUnderside_m)) continue;
      const Eigen::Vector3d p_W = data.X_WL[s.body] * p_L;
      double overhang = 1e9;
      for (const Placed& p : primitives) {
        overhang = std::min(overhang, p.primitive.distance(p.X_WF.inverse() * p_W));
      }
      ASSERT_LE(overhang, 0.04) << "body " << s.body << ": " << p_L.transpose();
    }
  }
}

}  // namespace
}  // namespace wb
