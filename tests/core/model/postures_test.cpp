// What robot.yaml's postures and self-collision pairs promise, on the URDF's primitives and FCL's
// distance of capsules.
#include <fcl/narrowphase/distance.h>
#include <gtest/gtest.h>

#include <Eigen/SVD>

#include "core/model/robot_model.hpp"
#include "tests/core/model/mujoco_oracle.hpp"
#include "tests/core/model/primitives.hpp"
#include "tests/core/model/robots.hpp"

namespace wb {
namespace {

constexpr double kSpacing_m = 0.01;
constexpr double kPairDistance_m = 0.05;  // that the MPC keeps

class PosturesOf {
 protected:
  explicit PosturesOf(const RobotConfig& config) : model_(config) {}

  RobotModel model_;
  test::MujocoOracle plant_{model_.config()};
  std::vector<test::Primitive> primitives_ = test::primitives_of(*read_urdf(model_.config().urdf));

  // The base at W's origin.
  RobotModel::Data at(const std::vector<double>& q) const {
    StateVector x = StateVector::Zero(model_.nx());
    std::copy(q.begin(), q.end(), x.data() + model_.base_dof());
    RobotModel::Data data;
    model_.forward_kinematics(x.data(), data);
    return data;
  }

  std::string plant_contact(const std::vector<double>& q) {
    StateVector x = StateVector::Zero(model_.nx());
    std::copy(q.begin(), q.end(), x.data() + model_.base_dof());
    const JointVector rest = JointVector::Zero(model_.joints());
    plant_.set(model_, x.data(), rest.data());
    return plant_.contact();
  }

  // Smallest distance among the pairs; touching or deeper is 0 or less.
  double pair_distance(const RobotModel::Data& data) const {
    double smallest = 1e9;
    for (const auto& pair : model_.self_pairs()) {
      fcl::DistanceRequest<double> request;
      fcl::DistanceResult<double> result;
      const Capsule& a = model_.capsules()[pair[0]];
      const Capsule& b = model_.capsules()[pair[1]];
      const fcl::Capsuled shape_a(a.radius, (a.p1 - a.p0).norm());
      const fcl::Capsuled shape_b(b.radius, (b.p1 - b.p0).norm());
      smallest = std::min(smallest, fcl::distance(&shape_a, pose(a, data), &shape_b, pose(b, data),
                                                  request, result));
    }
    return smallest;
  }

  // Of all points of the robot's surface in W, by link; an open finger's too.
  template <typename F>
  void for_surface(const RobotModel::Data& data, F f) const {
    for (const test::Primitive& p : primitives_) {
      const Eigen::Isometry3d X_WF = model_.X_WF(model_.frame(p.link), data);
      const double stroke =
          p.link == "finger_left_link"    ? 0.5 * model_.config().gripper_opening_max_m
          : p.link == "finger_right_link" ? -0.5 * model_.config().gripper_opening_max_m
                                          : 0;
      for (const Eigen::Vector3d& p_F : p.surface(kSpacing_m)) {
        f(p.link, X_WF * p_F);
        if (stroke != 0) f(p.link, X_WF * (p_F + Eigen::Vector3d(0, stroke, 0)));
      }
    }
  }

  // Largest gravity torque as a fraction of its joint's limit.
  double load(const std::vector<double>& q) const {
    JointVector tau;
    model_.gravity(q.data(), tau);
    double largest = 0;
    for (int i = 0; i < model_.joints(); ++i) {
      largest = std::max(largest, std::abs(tau[i]) / model_.limits(i).torque);
    }
    return largest;
  }

  const std::vector<double>& stowed() const { return model_.config().stowed; }
  const std::vector<double>& ready() const { return model_.config().ready; }

 private:
  static Eigen::Isometry3d pose(const Capsule& c, const RobotModel::Data& data) {
    const Eigen::Isometry3d& X_WL = data.X_WL[c.body];
    Eigen::Isometry3d X_WC = Eigen::Isometry3d::Identity();
    X_WC.translation() = X_WL * (0.5 * (c.p0 + c.p1));
    X_WC.linear() =
        Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), X_WL.linear() * (c.p1 - c.p0))
            .toRotationMatrix();
    return X_WC;
  }
};

class Postures : public PosturesOf, public ::testing::Test {
 protected:
  Postures() : PosturesOf(test::mabi_mobile()) {}
};

class EveryRobotsPostures : public PosturesOf, public ::testing::TestWithParam<std::string> {
 protected:
  EveryRobotsPostures() : PosturesOf(test::robot(GetParam())) {}
};
INSTANTIATE_TEST_SUITE_P(Robots, EveryRobotsPostures, ::testing::ValuesIn(test::robot_names()),
                         [](const auto& info) { return info.param; });

bool carried_by_base(const std::string& link) {
  return link == "base" || link.starts_with("wheel");
}

TEST_F(Postures, StowedFitsTheBoundingCircleAboveTheChassis) {
  for_surface(at(stowed()), [&](const std::string& link, const Eigen::Vector3d& p_W) {
    ASSERT_LE(p_W.head<2>().norm(), model_.config().base.bounding_radius_m) << link;
    if (carried_by_base(link) || link == "SHOULDER") return;
    ASSERT_GE(p_W.z(), 0.25) << link;
  });
}

TEST_F(Postures, StowedKeepsItsPairsApartAndLoadsLittle) {
  EXPECT_GE(pair_distance(at(stowed())), kPairDistance_m);
  EXPECT_LE(load(stowed()), 0.6);
  EXPECT_EQ(plant_contact(stowed()), "");
}

TEST_F(Postures, StowedLeavesTheShoulderCamerasViewFree) {
  const RobotModel::Data data = at(stowed());
  const auto camera = std::find_if(
      model_.config().cameras.begin(), model_.config().cameras.end(),
      [&](const CameraConfig& c) { return c.name == model_.config().shoulder_camera; });
  const CameraIntrinsics& k = camera->intrinsics;
  const Eigen::Isometry3d X_CW = model_.X_WF(model_.frame(camera->name), data).inverse();
  for_surface(data, [&](const std::string& link, const Eigen::Vector3d& p_W) {
    const Eigen::Vector3d p = X_CW * p_W;
    if (p.z() <= 0 || carried_by_base(link)) return;
    const double u = k.cx + k.fx * p.x() / p.z(), v = k.cy + k.fy * p.y() / p.z();
    ASSERT_FALSE(u >= 0 && u < k.width && v >= 0 && v < k.height) << link;
  });
}

TEST_F(Postures, ReadyHoldsTheHandAtAHorizontalBar) {
  const RobotModel::Data data = at(ready());
  const Eigen::Isometry3d X_BE = model_.X_WF(model_.end_effector(), data);
  constexpr double kAngle_rad = 1e-3;  // robot.yaml's digits
  EXPECT_NEAR(X_BE.translation().z(), 0.80, 0.01);
  EXPECT_GE(X_BE.translation().x(), 0.75);
  EXPECT_LE(X_BE.translation().x(), 0.95);
  EXPECT_GE(X_BE.linear().col(2).x(), std::cos(kAngle_rad));
  EXPECT_GE(std::abs(X_BE.linear().col(1).z()), std::cos(kAngle_rad));
  EXPECT_GT(model_.X_WF(model_.frame("ELBOW"), data).translation().z(), X_BE.translation().z());
  EXPECT_NEAR(ready()[0], -M_PI / 2, kAngle_rad);  // the shoulder camera looks forward
  EXPECT_GT(ready()[1], -M_PI / 2);
  EXPECT_LT(ready()[1], 0);
}

TEST_F(Postures, ReadyIsFarFromLimitsSingularitiesAndItself) {
  const RobotModel::Data data = at(ready());
  for (int i = 0; i < model_.joints(); ++i) {
    EXPECT_GE(ready()[i] - model_.limits(i).lower, 0.5) << i;
    EXPECT_GE(model_.limits(i).upper - ready()[i], 0.5) << i;
  }
  Jacobian J;
  model_.frame_jacobian(model_.end_effector(), data, J);
  const Eigen::MatrixXd J_arm = J.rightCols(model_.joints());
  EXPECT_GE(Eigen::JacobiSVD<Eigen::MatrixXd>(J_arm).singularValues().tail<1>()[0], 0.15);
  EXPECT_GE(pair_distance(data), 0.08);
  EXPECT_LE(load(ready()), 0.65);
  EXPECT_EQ(plant_contact(ready()), "");
}

// The hand hides the middle of a bar 0.15 m before it; the shoulder camera must still see the half
// on its own side.
TEST_F(Postures, ReadyLeavesHalfOfTheBarInTheShoulderCamerasView) {
  const RobotModel::Data data = at(ready());
  const Eigen::Isometry3d X_WC = model_.X_WF(model_.frame(model_.config().shoulder_camera), data);
  const Eigen::Isometry3d X_WE = model_.X_WF(model_.end_effector(), data);
  for (double y = -0.25; y <= -0.05; y += 0.02) {
    const Eigen::Vector3d bar_W = X_WE.translation() + Eigen::Vector3d(0.15, y, 0);
    for (double s = 0; s <= 1; s += 0.01) {
      const Eigen::Vector3d p_W = X_WC.translation() + s * (bar_W - X_WC.translation());
      for (const test::Primitive& p : primitives_) {
        const Eigen::Isometry3d X_WF = model_.X_WF(model_.frame(p.link), data);
        ASSERT_GT(p.distance(X_WF.inverse() * p_W), 0) << p.name << " hides y = " << y;
      }
    }
  }
}

TEST_P(EveryRobotsPostures, StowedFitsTheBoundingCircle) {
  for_surface(at(stowed()), [&](const std::string& link, const Eigen::Vector3d& p_W) {
    ASSERT_LE(p_W.head<2>().norm(), model_.config().base.bounding_radius_m) << link;
  });
}

// Where the base stops before an object, and how the hand takes a bar there.
TEST_P(EveryRobotsPostures, ReadyPointsTheHandForwardAtAHandlesHeight) {
  const Eigen::Isometry3d X_BE = model_.X_WF(model_.end_effector(), at(ready()));
  EXPECT_NEAR(X_BE.translation().z(), 0.80, 0.01);
  EXPECT_GE(X_BE.linear().col(2).x(), std::cos(2e-3));  // robot.yaml's digits
  EXPECT_GE(std::abs(X_BE.linear().col(1).z()), std::cos(2e-3));
}

TEST_P(EveryRobotsPostures, StraightFromStowedToReadyTouchesNothingAndFindsTheTorque) {
  for (int k = 0; k <= 50; ++k) {
    std::vector<double> q = stowed();
    for (std::size_t i = 0; i < q.size(); ++i) q[i] += 0.02 * k * (ready()[i] - q[i]);
    EXPECT_GE(pair_distance(at(q)), kPairDistance_m) << k;
    EXPECT_LE(load(q), 0.8) << k;
    EXPECT_EQ(plant_contact(q), "") << k;
  }
}

TEST_F(Postures, StraightFromStowedToReadyKeepsPairsApartAndLoadsLittle) {
  for (int k = 0; k <= 100; ++k) {
    std::vector<double> q = stowed();
    for (std::size_t i = 0; i < q.size(); ++i) q[i] += 0.01 * k * (ready()[i] - q[i]);
    EXPECT_GE(pair_distance(at(q)), kPairDistance_m) << k;
    EXPECT_LE(load(q), 0.6) << k;
    EXPECT_EQ(plant_contact(q), "") << k;
  }
}

// Capsules cover the primitives within 25 mm, so that primitives in contact are capsules within 50
// mm.
TEST_P(EveryRobotsPostures, EveryContactOfThePlantIsNearASelfPair) {
  std::mt19937 random(1);
  int contacts = 0;
  for (int k = 0; k < 5000; ++k) {
    const StateVector x = test::random_state(model_, random);
    const std::vector<double> q(x.data() + model_.base_dof(), x.data() + model_.nx());
    const std::string contact = plant_contact(q);
    if (contact.empty()) continue;
    ++contacts;
    ASSERT_LE(pair_distance(at(q)), kPairDistance_m) << contact;
  }
  EXPECT_GT(contacts, 50);
}

}  // namespace
}  // namespace wb
