// Friction decides what a grasp can pull: the gripper around drawer_1's bar, the base driving back.
#include <gtest/gtest.h>

#include <memory>

#include "core/model/robot_model.hpp"
#include "sim_driver.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
using test::sim_config;
using test::SimDriver;

// The robot, standing where its ready posture puts the hand around drawer_1's bar: `off_centre_m`
// above the bar's middle, 5 mm behind it.
class Grasp {
 public:
  Grasp(const std::string& overrides, double off_centre_m) {
    reach(off_centre_m);
    const Vector3d p_BE = hand().translation();
    std::string posture;
    for (const double v : q_) posture += (posture.empty() ? "" : ", ") + std::to_string(v);
    sim_ = std::make_unique<SimDriver>(
        sim_config("spawn: {x_m: " + std::to_string(kBar.x() + 0.005 - p_BE.x()) +
                   ", y_m: " + std::to_string(kBar.y() - p_BE.y()) + ", yaw_rad: 0, posture: [" +
                   posture + "]}" + overrides));
    drawer_ = sim_->object_index("drawer_1");
    EXPECT_EQ(sim_->activate(), WB_OK);
    JointVector gravity;
    model_.gravity(q_.data(), gravity);
    const double stiffness[6] = {3000, 3000, 2000, 400, 300, 100},
                 damping[6] = {120, 120, 80, 15, 10, 4};
    for (int i = 0; i < model_.joints(); ++i)
      commands_.joints[i] = {WB_CMD_IMPEDANCE, q_[i], 0, gravity[i], stiffness[i], damping[i]};
    commands_.joints[6].kind = commands_.joints[7].kind = WB_CMD_VELOCITY;
  }

  void close(double force_n) {
    commands_.gripper = {0.0, force_n};
    sim_->run(1.0, [&](TimeNs) { return commands_; });
    grasp_ = hand_in_handle();
  }
  // 0.3 m back in 3 s.
  void drive_back() {
    commands_.joints[6].velocity = commands_.joints[7].velocity = -1.0;
    sim_->run(3.0, [&](TimeNs) { return commands_; });
  }

  SimDriver& sim() { return *sim_; }
  double opened_m() const { return sim_->object("drawer_1").value; }
  double slip_m() const { return (hand_in_handle() - grasp_).norm(); }
  void expect_no_touch() const {
    for (std::uint32_t i = 0; i < sim_->truth().contact_count(sim_->get()); ++i) {
      wb_sim_contact touch{};
      sim_->truth().contact(sim_->get(), i, &touch);
      ADD_FAILURE() << touch.robot_geom << " touched " << touch.other_geom;
    }
  }

 private:
  const Vector3d kBar{0.96, 1.2, 0.808};

  Eigen::Isometry3d hand() {
    double x[kMaxStates] = {0, 0, 0};
    std::copy(q_.begin(), q_.end(), x + 3);
    model_.forward_kinematics(x, data_);
    return model_.X_WF(model_.end_effector(), data_);
  }
  // Brings the hand to the bar's height, all else as in the ready posture: damped least squares.
  void reach(double off_centre_m) {
    const Eigen::Isometry3d X_BE_ready = hand();
    for (int i = 0; i < 50; ++i) {
      const Eigen::Isometry3d X_BE = hand();
      Eigen::Matrix<double, 6, 1> error;
      error.head<3>() = X_BE_ready.translation() - X_BE.translation();
      error.z() = kBar.z() + off_centre_m - X_BE.translation().z();
      const Eigen::AngleAxisd turn(X_BE_ready.linear() * X_BE.linear().transpose());
      error.tail<3>() = turn.angle() * turn.axis();
      Jacobian J;
      model_.frame_jacobian(model_.end_effector(), data_, J);
      const Eigen::MatrixXd arm = J.rightCols(model_.joints());
      const Eigen::VectorXd dq =
          arm.transpose() *
          (arm * arm.transpose() + 1e-6 * Eigen::MatrixXd::Identity(6, 6)).ldlt().solve(error);
      for (int k = 0; k < model_.joints(); ++k) q_[k] += dq[k];
    }
  }
  Vector3d hand_in_handle() const {
    wb_sim_pose X_GE{};
    sim_->truth().hand_in_handle(sim_->get(), drawer_, &X_GE);
    return Eigen::Map<const Vector3d>(X_GE.p);
  }

  RobotModel model_{RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile")};
  RobotModel::Data data_;
  std::vector<double> q_ = model_.config().ready;
  std::unique_ptr<SimDriver> sim_;
  std::uint32_t drawer_ = 0;
  wb_commands commands_{};
  Vector3d grasp_ = Vector3d::Zero();
};

class Centring : public testing::TestWithParam<double> {};

TEST_P(Centring, FrictionAloneOpensADrawer) {
  Grasp grasp("", GetParam());
  grasp.close(40);
  EXPECT_NEAR(grasp.sim().read().gripper.opening, 0.012, 1e-3);  // the bar's diameter
  EXPECT_NEAR(grasp.sim().read().gripper.force, 40, 3);
  grasp.drive_back();
  EXPECT_GT(grasp.opened_m(), 0.27);  // the arm yields by some cm
  EXPECT_LT(grasp.slip_m(), 2e-3);
  grasp.expect_no_touch();
}
INSTANTIATE_TEST_SUITE_P(OffCentre, Centring, testing::Values(-0.012, 0.0, 0.012));

TEST(SimGrasp, AGripOf20NSlipsOnADrawerThatNeeds60N) {
  Grasp grasp(", objects: {drawer_1: {friction_n: 60}}", 0);
  grasp.close(20);  // twice 20 N at a friction of 1 hold 40 N
  grasp.drive_back();
  EXPECT_LT(grasp.opened_m(), 0.01);
  EXPECT_GT(grasp.slip_m(), 0.05);
}

TEST(SimGrasp, AGripOf70NOpensADrawerThatNeeds60N) {
  Grasp grasp(", objects: {drawer_1: {friction_n: 60}}", 0);
  grasp.close(70);
  grasp.drive_back();
  EXPECT_GT(grasp.opened_m(), 0.2);
  EXPECT_LT(grasp.slip_m(), 3e-3);
}

TEST(SimGrasp, TimeOutKeepsTheGrip) {
  Grasp grasp("", 0);
  grasp.close(40);
  grasp.sim().advance(from_seconds(2.0));  // no more writes
  EXPECT_TRUE(grasp.sim().read().timed_out);
  EXPECT_NEAR(grasp.sim().read().gripper.force, 40, 3);
  EXPECT_LT(grasp.slip_m(), 1e-3);
}

}  // namespace
}  // namespace wb
