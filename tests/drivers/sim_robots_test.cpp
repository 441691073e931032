// The simulated plant of every robot in config/robots: it stands still under its brakes, weighs and
// describes what its files say, and its base does what its wheels say.
#include <gtest/gtest.h>

#include <cmath>

#include "core/model/robot_model.hpp"
#include "core/model/wheel_kinematics.hpp"
#include "drivers/sim/plant.hpp"
#include "tests/core/model/robots.hpp"

namespace wb::sim {
namespace {

PluginConfig plugin_config(const std::string& robot) {
  return PluginConfig::parse("{robot: robots/" + robot +
                                 ", scene: scenes/kitchen_line.yaml, seed: 1, "
                                 "spawn: {x_m: -1.5, y_m: -1.2, yaw_rad: 0.3, posture: stowed}}",
                             WB_SOURCE_DIR "/config");
}

void run(Plant& plant, double seconds) {
  for (const TimeNs end = plant.time_ns() + from_seconds(seconds); plant.time_ns() < end;)
    plant.step();
}

class PlantOf : public ::testing::TestWithParam<std::string> {
 protected:
  const PluginConfig config = plugin_config(GetParam());
  Plant plant{config};
  const int base = plant.body(config.robot.base.link);

  double joint(const std::string& name) const {
    return plant.data()
        .qpos[plant.model().jnt_qposadr[mj_name2id(&plant.model(), mjOBJ_JOINT, name.c_str())]];
  }
  // Holds the arm by impedance, turns the wheels so that the base moves with `v`.
  void drive(const WheelKinematics::Twist& v, double seconds) {
    const WheelKinematics kinematics(config.robot.base);
    const WheelKinematics::Wheels speed = kinematics.wheel_speeds(v);
    wb_commands commands{};
    const int arm = plant.servos().arm_joints();
    for (int i = 0; i < arm; ++i) commands.joints[i].kind = WB_CMD_NONE;
    for (int i = 0; i < kinematics.wheels(); ++i) {
      commands.joints[arm + i].kind = WB_CMD_VELOCITY;
      commands.joints[arm + i].velocity = speed[i];
    }
    for (const TimeNs end = plant.time_ns() + from_seconds(seconds); plant.time_ns() < end;) {
      ASSERT_EQ(plant.servos().write(commands, plant.time_ns()), WB_OK);
      plant.step();
    }
  }
};
INSTANTIATE_TEST_SUITE_P(Robots, PlantOf, ::testing::ValuesIn(test::robot_names()),
                         [](const auto& info) { return info.param; });

TEST_P(PlantOf, StandsStillUnderItsBrakes) {
  const Eigen::Isometry3d before = plant.X_S(base);
  EXPECT_NEAR(before.translation().x(), -1.5, 0.002);
  EXPECT_NEAR(before.translation().y(), -1.2, 0.002);
  run(plant, 2.0);
  const Eigen::Isometry3d after = plant.X_S(base);
  EXPECT_LE((after.translation() - before.translation()).norm(), 0.002);
  EXPECT_LE(Eigen::AngleAxisd(before.linear().transpose() * after.linear()).angle(), 0.002);
  for (std::size_t i = 0; i < config.robot.joints.size(); ++i)
    EXPECT_NEAR(joint(config.robot.joints[i].name), config.robot.stowed[i], 0.005)
        << config.robot.joints[i].name;
  EXPECT_EQ(plant.contacts().touches().size(), 0u);
  EXPECT_TRUE(plant.healthy());
}

TEST_P(PlantOf, WeighsWhatTheModelWeighs) {
  const double mass = plant.model().body_subtreemass[base];
  EXPECT_NEAR(mass, RobotModel(config.robot).mass(), 1e-9 * mass);
}

TEST_P(PlantOf, HasTheSensorsThatItsFileNames) {
  EXPECT_EQ(plant.readings().imu.valid != 0, !config.sim.imu.empty());
  EXPECT_EQ(plant.readings().wrench.valid != 0, !config.sim.wrench_link.empty());
  EXPECT_EQ(plant.readings().gripper.valid != 0, !config.robot.fingers.empty());
}

TEST_P(PlantOf, BaseMovesAsItsWheelsTurn) {
  if (config.robot.base.kind == BaseKind::kFixed) {
    EXPECT_EQ(plant.servos().drives().size(), config.robot.joints.size());
    return;
  }
  const wb_timeout_action hold[WB_DRIVER_MAX_JOINTS] = {};
  plant.servos().activate(50'000'000, hold);
  const bool sideways = config.robot.base.kind == BaseKind::kOmnidirectional;
  for (const WheelKinematics::Twist& v :
       {WheelKinematics::Twist{0.3, 0, 0}, {0, sideways ? 0.3 : 0.0, 0}, {0, 0, 0.5}}) {
    drive(v, 1.0);  // up to speed
    const Eigen::Isometry3d from = plant.X_S(base);
    drive(v, 1.0);
    const Eigen::Isometry3d moved = from.inverse() * plant.X_S(base);
    EXPECT_NEAR(moved.translation().x(), v[0], 0.01);
    EXPECT_NEAR(moved.translation().y(), v[1], 0.01);
    EXPECT_NEAR(std::atan2(moved(1, 0), moved(0, 0)), v[2], 0.01);
    drive({0, 0, 0}, 1.0);
  }
  EXPECT_EQ(plant.contacts().touches().size(), 0u);
}

// A mecanum base pushed sideways harder than its rollers' friction slides; less hard, it stays.
TEST(Rollers, HoldTheBaseUpToTheirFrictionAndSlideBeyond) {
  const PluginConfig config = plugin_config("ridgeback_ur5");
  // Per wheel friction * load along its axis; of a sideways push each axis takes 1 / sqrt 2.
  Plant plant(config);
  const int base = plant.body(config.robot.base.link);
  const double weight_n = 9.81 * plant.model().body_subtreemass[base];
  const double most_n = config.sim.wheels.roller_friction * weight_n * M_SQRT1_2;
  const double none[3] = {0, 0, 0};
  for (const double part : {0.5, 1.5}) {
    const Eigen::Vector3d from = plant.X_S(base).translation();
    const Eigen::Vector3d push = part * most_n * plant.X_S(base).linear().col(1);
    plant.push(base, push.data(), none);
    run(plant, 0.5);
    const double way_m = (plant.X_S(base).translation() - from).head<2>().norm();
    if (part < 1) {
      EXPECT_LT(way_m, 0.03);  // creep: push / (2 slip) for half a second
    } else {
      EXPECT_GT(way_m, 0.2);  // half of (1.5 - 1) most / mass * t^2 is 0.3
    }
  }
}

}  // namespace
}  // namespace wb::sim
