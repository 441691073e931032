#include "core/model/robot_model.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "core/config/config.hpp"
#include "core/model/urdf_file.hpp"
#include "core/rt/allocation_count.hpp"
#include "tests/core/model/mujoco_oracle.hpp"
#include "tests/core/model/robots.hpp"

namespace wb {
namespace {

constexpr int kConfigurations = 200;
// Both sides compute in double; lengths are up to 10 m, torques up to some 100 Nm, over ten joints:
// 1e-9 leaves 1e4 of rounding.
constexpr double kRelative = 1e-9;

class RobotModelOf : public ::testing::TestWithParam<std::string> {
 protected:
  RobotModel model_{GetParam() == "tree" ? test::tree() : test::robot(GetParam())};
  test::MujocoOracle oracle_{model_.config()};
  urdf::ModelInterfaceSharedPtr urdf_ = read_urdf(model_.config().urdf);
  std::mt19937 random_{1};
  RobotModel::Data data_;

  void expect_near(const Eigen::MatrixXd& actual, const Eigen::MatrixXd& expected,
                   const std::string& what, double relative = kRelative) {
    ASSERT_EQ(actual.rows(), expected.rows()) << what;
    ASSERT_EQ(actual.cols(), expected.cols()) << what;
    EXPECT_LE((actual - expected).cwiseAbs().maxCoeff(),
              relative * std::max(1.0, expected.cwiseAbs().maxCoeff()))
        << what;
  }

  void for_random_states(const std::function<void(const StateVector&, const JointVector&)>& f) {
    for (int k = 0; k < kConfigurations && !HasFailure(); ++k) {
      const StateVector x = test::random_state(model_, random_);
      const JointVector dq = test::random_rates(model_, random_);
      model_.forward_kinematics(x.data(), data_);
      oracle_.set(model_, x.data(), dq.data());
      f(x, dq);
    }
  }
};

std::vector<std::string> names() {
  std::vector<std::string> out = test::robot_names();
  out.push_back("tree");
  return out;
}
INSTANTIATE_TEST_SUITE_P(Robots, RobotModelOf, ::testing::ValuesIn(names()),
                         [](const auto& info) { return info.param; });

TEST_P(RobotModelOf, WeighsWhatMujocoSays) {
  EXPECT_NEAR(model_.mass(), oracle_.mass(), kRelative * model_.mass());
}

TEST_P(RobotModelOf, PutsEveryLinkWhereMujocoDoes) {
  for_random_states([&](const StateVector&, const JointVector&) {
    for (const auto& [name, link] : urdf_->links_) {
      expect_near(model_.X_WF(model_.frame(name), data_).matrix(), oracle_.X_WF(name).matrix(),
                  name);
    }
  });
}

TEST_P(RobotModelOf, JacobiansOfEveryLinkEqualMujocos) {
  for_random_states([&](const StateVector&, const JointVector&) {
    for (const auto& [name, link] : urdf_->links_) {
      Jacobian J;
      model_.frame_jacobian(model_.frame(name), data_, J);
      expect_near(J, oracle_.frame_jacobian(model_, name), name);
    }
  });
}

TEST_P(RobotModelOf, MassMatrixEqualsMujocos) {
  for_random_states([&](const StateVector& x, const JointVector&) {
    JointMatrix M;
    model_.mass_matrix(x.data() + model_.base_dof(), M);
    expect_near(M, oracle_.mass_matrix(), "M");
  });
}

TEST_P(RobotModelOf, InverseDynamicsEqualMujocos) {
  for_random_states([&](const StateVector& x, const JointVector& dq) {
    const JointVector ddq = test::random_rates(model_, random_);
    JointVector tau;
    model_.inverse_dynamics(x.data() + model_.base_dof(), dq.data(), ddq.data(), tau);
    expect_near(tau, oracle_.mass_matrix() * ddq + oracle_.bias(), "tau");
  });
}

TEST_P(RobotModelOf, GravityIsWhatHoldsItStill) {
  for_random_states([&](const StateVector& x, const JointVector&) {
    const JointVector rest = JointVector::Zero(model_.joints());
    oracle_.set(model_, x.data(), rest.data());
    JointVector tau;
    model_.gravity(x.data() + model_.base_dof(), tau);
    expect_near(tau, oracle_.bias(), "gravity");
  });
}

// Central differences with step h: h^2 / 6 times a third derivative (at most 10 m/rad^3) and 1e-15
// / h of rounding.
TEST_P(RobotModelOf, PointJacobiansAreTheDerivativesOfPositions) {
  constexpr double kStep = 1e-5, kTolerance = 1e-9;
  for_random_states([&](const StateVector& x, const JointVector&) {
    for (int body = 0; body <= model_.joints(); ++body) {
      const Eigen::Vector3d p_L = Eigen::Vector3d::Random();
      PointJacobian J;
      model_.point_jacobian(body, data_.X_WL[body] * p_L, data_, J);
      for (int i = 0; i < model_.nx(); ++i) {
        RobotModel::Data above, below;
        StateVector y = x;
        y[i] = x[i] + kStep;
        model_.forward_kinematics(y.data(), above);
        y[i] = x[i] - kStep;
        model_.forward_kinematics(y.data(), below);
        const Eigen::Vector3d derivative =
            (above.X_WL[body] * p_L - below.X_WL[body] * p_L) / (2 * kStep);
        EXPECT_LE((J.col(i) - derivative).norm(), kTolerance) << body << ", " << i;
      }
    }
  });
}

TEST_P(RobotModelOf, StepsDoNotAllocate) {
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns malloc";
  const StateVector x = test::random_state(model_, random_);
  const JointVector dq = test::random_rates(model_, random_);
  const double* q = x.data() + model_.base_dof();
  Jacobian J;
  PointJacobian J_point;
  JointVector tau;
  JointMatrix M;
  const std::uint64_t before = thread_allocations();
  model_.forward_kinematics(x.data(), data_);
  const Eigen::Isometry3d X_WE = model_.X_WF(model_.end_effector(), data_);
  model_.frame_jacobian(model_.end_effector(), data_, J);
  model_.point_jacobian(model_.joints(), X_WE.translation(), data_, J_point);
  model_.inverse_dynamics(q, dq.data(), dq.data(), tau);
  model_.gravity(q, tau);
  model_.mass_matrix(q, M);
  EXPECT_EQ(thread_allocations() - before, 0u);
}

TEST(RobotModel, KnowsTheHandsWeightBeyondTheWristSensor) {
  const RobotModel model(test::mabi_mobile());
  Eigen::Vector3d com;
  // robot.urdf: hand 0.73 kg at z = 0.03 m, two fingers of 0.05 kg at z = 0.0584 + 0.02 m, mirrored
  // in y.
  EXPECT_DOUBLE_EQ(model.mass_beyond(model.frame("hand"), com), 0.83);
  const Eigen::Vector3d expected(0, 0, (0.73 * 0.03 + 0.1 * 0.0784) / 0.83);
  EXPECT_LE((com - expected).norm(), 1e-15);
  EXPECT_EQ(model.mass_beyond(model.end_effector(), com), 0);
  EXPECT_NEAR(model.mass_beyond(model.frame("base"), com), 188,
              1e-12);  // with its wheels, without the arm
}

TEST(RobotModel, TakesLimitsFromTheUrdfAndAccelerationsFromRobotYaml) {
  const RobotModel model(test::mabi_mobile());
  EXPECT_EQ(model.nx(), 9);
  EXPECT_EQ(model.nu(), 8);
  EXPECT_DOUBLE_EQ(model.limits(1).lower, -3.14159265359);
  EXPECT_DOUBLE_EQ(model.limits(1).upper, 0);
  EXPECT_DOUBLE_EQ(model.limits(2).torque, 100);
  EXPECT_DOUBLE_EQ(model.limits(5).velocity, 4.79965544298);
  EXPECT_DOUBLE_EQ(model.limits(0).acceleration, 4.0);
}

std::string error_of(const RobotConfig& config) {
  try {
    RobotModel model(config);
  } catch (const config::ConfigError& e) {
    return e.what();
  }
  return "";
}

TEST(RobotModel, JointsMayBeListedBeforeTheirCarriers) {
  RobotConfig config = test::tree();
  const RobotModel model(config);
  std::swap(config.joints[0], config.joints[3]);
  const RobotModel swapped(config);
  std::mt19937 random(1);
  StateVector x = test::random_state(model, random);
  RobotModel::Data a, b;
  model.forward_kinematics(x.data(), a);
  std::swap(x[0], x[3]);
  swapped.forward_kinematics(x.data(), b);
  for (const char* link : {"left_tip", "spinner"}) {
    EXPECT_TRUE(model.X_WF(model.frame(link), a).isApprox(swapped.X_WF(swapped.frame(link), b)));
  }
}

TEST(RobotModel, AContinuousJointHasNoEnds) {
  const RobotModel model(test::tree());
  for (int i = 0; i < model.joints(); ++i) {
    EXPECT_EQ(model.limits(i).endless(), model.config().joints[i].name == "f");
    EXPECT_LT(model.limits(i).lower, model.limits(i).upper);
  }
}

TEST(RobotModel, AMimicJointFollowsItsMasterAndHasNoStateOfItsOwn) {
  const RobotModel model(test::tree());
  EXPECT_EQ(model.joints(), 5);
  StateVector x = StateVector::Zero(model.nx());
  x[2] = 0.8;  // c; g = 0.5 c - 0.1 along its own y
  RobotModel::Data data;
  model.forward_kinematics(x.data(), data);
  const Eigen::Isometry3d X =
      model.X_WF(model.frame("left_tip"), data).inverse() * model.X_WF(model.frame("slider"), data);
  EXPECT_LE((X.translation() - Eigen::Vector3d(0, 0.1 + 0.5 * 0.8 - 0.1, 0)).norm(), 1e-12);
}

TEST(RobotModel, RefusesAnUnknownFrame) {
  RobotConfig config = test::tree();
  config.end_effector = "nothing";
  const std::string e = error_of(config);
  EXPECT_NE(e.find("tree.urdf"), std::string::npos) << e;
  EXPECT_NE(e.find("'nothing'"), std::string::npos) << e;
}

}  // namespace
}  // namespace wb
