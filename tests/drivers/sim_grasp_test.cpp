// Friction decides what a grasp can pull: the gripper around drawer_1's bar, the base driving back.
#include <gtest/gtest.h>

#include <cmath>

#include "core/model/robot_model.hpp"
#include "core/types/pose.hpp"
#include "sim_driver.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
using test::sim_config;
using test::SimDriver;

Eigen::Isometry3d isometry(const wb_sim_pose& pose) { return Pose{std::to_array(pose.p), std::to_array(pose.q)}.isometry(); }

struct Pull {
  double opened_m = 0;      // of the drawer
  double slip_m = 0;        // hand against handle since the grasp
  double grip_n = 0;        // what the gripper reports
  double settled_m = 0;     // opening of the gripper around the bar
};

// The robot stands where its ready posture puts the hand `off_centre_m` above the bar's middle and 5 mm behind it; it closes the
// gripper and drives back 0.3 m in 3 s.
Pull pull(const std::string& overrides, double force_n, double off_centre_m) {
  const RobotModel model(RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile"));
  std::vector<double> q = model.config().ready;
  const Vector3d bar(0.96, 1.2, 0.808);

  // Height by the elbow and shoulder, keeping the hand level: damped least squares on the model.
  RobotModel::Data data;
  Eigen::Isometry3d X_BE_ready;
  double x[kMaxStates] = {0, 0, 0};
  const auto forward = [&] {
    std::copy(q.begin(), q.end(), x + 3);
    model.forward_kinematics(x, data);
    return model.X_WF(model.end_effector(), data);
  };
  X_BE_ready = forward();
  for (int i = 0; i < 50; ++i) {
    const Eigen::Isometry3d X_BE = forward();
    Eigen::Matrix<double, 6, 1> error;
    error << 0, 0, bar.z() + off_centre_m - X_BE.translation().z(), 0, 0, 0;
    error.head<2>() = (X_BE_ready.translation() - X_BE.translation()).head<2>();
    const Eigen::AngleAxisd turn(X_BE_ready.linear() * X_BE.linear().transpose());
    error.tail<3>() = turn.angle() * turn.axis();
    Jacobian J;
    model.frame_jacobian(model.end_effector(), data, J);
    const Eigen::MatrixXd arm = J.rightCols(model.joints());
    const Eigen::VectorXd dq =
        arm.transpose() * (arm * arm.transpose() + 1e-6 * Eigen::MatrixXd::Identity(6, 6)).ldlt().solve(error);
    for (int k = 0; k < model.joints(); ++k) q[k] += dq[k];
  }
  const Vector3d p_BE = forward().translation();
  std::string posture;
  for (const double v : q) posture += (posture.empty() ? "" : ", ") + std::to_string(v);
  SimDriver sim(sim_config("spawn: {x_m: " + std::to_string(bar.x() + 0.005 - p_BE.x()) + ", y_m: " +
                           std::to_string(bar.y() - p_BE.y()) + ", yaw_rad: 0, posture: [" + posture + "]}" + overrides));
  EXPECT_EQ(sim.truth().contact_count(sim.get()), 0u);
  EXPECT_EQ(sim.activate(), WB_OK);

  JointVector gravity;
  model.gravity(q.data(), gravity);
  wb_commands c{};
  const double stiffness[6] = {3000, 3000, 2000, 400, 300, 100}, damping[6] = {120, 120, 80, 15, 10, 4};
  for (int i = 0; i < model.joints(); ++i) c.joints[i] = {WB_CMD_IMPEDANCE, q[i], 0, gravity[i], stiffness[i], damping[i]};
  c.joints[6].kind = c.joints[7].kind = WB_CMD_VELOCITY;
  c.gripper = {0.0, force_n};
  sim.run(1.0, [&](TimeNs) { return c; });
  Pull result;
  result.settled_m = sim.read().gripper.opening;
  result.grip_n = sim.read().gripper.force;
  const std::uint32_t drawer = sim.object_index("drawer_1");
  wb_sim_pose X_GE{};
  sim.truth().hand_in_handle(sim.get(), drawer, &X_GE);
  const Vector3d grasp = isometry(X_GE).translation();
  c.joints[6].velocity = c.joints[7].velocity = -1.0;   // 0.1 m/s
  sim.run(3.0, [&](TimeNs) { return c; });
  sim.truth().hand_in_handle(sim.get(), drawer, &X_GE);
  result.slip_m = (isometry(X_GE).translation() - grasp).norm();
  result.opened_m = sim.object("drawer_1").value;
  for (std::uint32_t i = 0; i < sim.truth().contact_count(sim.get()); ++i) {
    wb_sim_contact touch{};
    sim.truth().contact(sim.get(), i, &touch);
    ADD_FAILURE() << touch.robot_geom << " touched " << touch.other_geom;
  }
  return result;
}

TEST(SimGrasp, FrictionAloneOpensADrawer) {
  const Pull p = pull("", 40, 0);
  EXPECT_NEAR(p.settled_m, 0.012, 1e-3);   // the bar's diameter
  EXPECT_NEAR(p.grip_n, 40, 3);
  EXPECT_GT(p.opened_m, 0.27);             // the arm yields by some cm
  EXPECT_LT(p.slip_m, 2e-3);
}

TEST(SimGrasp, ClosingOnABarOffCentreStillHolds) {
  const Pull p = pull("", 40, 0.012);
  EXPECT_NEAR(p.settled_m, 0.012, 1e-3);
  EXPECT_GT(p.opened_m, 0.27);
  EXPECT_LT(p.slip_m, 2e-3);
}

TEST(SimGrasp, AGripOf20NSlipsOnADrawerThatNeeds60N) {
  const Pull p = pull(", objects: {drawer_1: {friction_n: 60}}", 20, 0);   // 2 x 20 N at a friction of 1 hold 40 N
  EXPECT_LT(p.opened_m, 0.01);
  EXPECT_GT(p.slip_m, 0.05);
}

TEST(SimGrasp, AGripOf70NOpensADrawerThatNeeds60N) {
  const Pull p = pull(", objects: {drawer_1: {friction_n: 60}}", 70, 0);
  EXPECT_GT(p.opened_m, 0.2);
  EXPECT_LT(p.slip_m, 3e-3);
}

TEST(SimGrasp, TimeOutKeepsTheGrip) {
  // The same drawer, held; then no more writes.
  SimDriver sim(sim_config("spawn: {x_m: -1.0, y_m: -0.8, yaw_rad: 0.0}"));
  ASSERT_EQ(sim.activate(), WB_OK);
  wb_commands c{};
  c.gripper = {0.0, 30};
  sim.run(1.0, [&](TimeNs) { return c; });
  EXPECT_NEAR(sim.read().gripper.force, 30, 3);
  sim.advance(from_seconds(1.0));
  EXPECT_TRUE(sim.read().timed_out);
  EXPECT_NEAR(sim.read().gripper.force, 30, 3);
}

}  // namespace
}  // namespace wb
