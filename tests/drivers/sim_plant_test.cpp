// The simulated plant against the controller's model, and what its drives do with commands.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/model/robot_model.hpp"
#include "core/rt/allocation_count.hpp"
#include "core/types/pose.hpp"
#include "drivers/sim/plant.hpp"
#include "sim_driver.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
using test::kTick;
using test::sim_config;
using test::SimDriver;

const std::filesystem::path kConfig = WB_SOURCE_DIR "/config";
const std::string kSpawn = "spawn: {x_m: -1.0, y_m: -0.8, yaw_rad: 0.0}";

RobotModel make_model() { return RobotModel(RobotConfig::load(kConfig / "robots/mabi_mobile")); }

Eigen::Isometry3d isometry(const wb_sim_pose& pose) {
  return Pose{std::to_array(pose.p), std::to_array(pose.q)}.isometry();
}

// Impedance about q with gravity's feed-forward, wheels at v [m/s] and w [rad/s], gripper as it is.
wb_commands commands(const RobotModel& model, const double* q, double v, double w) {
  wb_commands c{};
  JointVector gravity;
  model.gravity(q, gravity);
  const int n = model.joints();
  for (int i = 0; i < n; ++i)
    c.joints[i] = {WB_CMD_IMPEDANCE,   q[i], 0, gravity[i], i < 3 ? 1500.0 : 150.0,
                   i < 3 ? 100.0 : 8.0};
  const BaseConfig& base = model.config().base;
  for (const int side : {0, 1}) {
    const double speed = v + (side == 0 ? -0.5 : 0.5) * base.track_m * w;
    c.joints[n + side] = {WB_CMD_VELOCITY, 0, speed / base.wheel_radius_m, 0, 0, 0};
  }
  c.gripper = {0.08, 30};
  return c;
}

TEST(SimPlant, HasTheMassAndGravityOfTheControllersModel) {
  // Compiled, not settled: the base stands level, the fingers at zero, as the model locks them.
  const auto config = sim::PluginConfig::parse(sim_config(kSpawn), kConfig);
  const sim::ModelPtr plant = sim::compile(sim::to_mjcf(config));
  const sim::DataPtr data(mj_makeData(plant.get()));
  const RobotModel model = make_model();
  double mass = 0;
  for (int b = 1; b < plant->nbody; ++b) {
    if (plant->body_rootid[b] == mj_name2id(plant.get(), mjOBJ_BODY, "base"))
      mass += plant->body_mass[b];
  }
  EXPECT_NEAR(mass, model.mass(), 1e-9 * mass);
  for (const std::vector<double>& q : {model.config().stowed, model.config().ready}) {
    const auto joint = [&](int i) {
      return mj_name2id(plant.get(), mjOBJ_JOINT, model.config().joints[i].name.c_str());
    };
    for (int i = 0; i < model.joints(); ++i) data->qpos[plant->jnt_qposadr[joint(i)]] = q[i];
    mj_forward(plant.get(), data.get());
    JointVector gravity;
    model.gravity(q.data(), gravity);
    for (int i = 0; i < model.joints(); ++i)
      EXPECT_NEAR(data->qfrc_bias[plant->jnt_dofadr[joint(i)]], gravity[i], 1e-9 * 200) << i;
  }
}

TEST(SimPlant, ArmTouchesRobotAndFloorButNotItsOwnNeighbours) {
  const auto config = sim::PluginConfig::parse(sim_config(kSpawn), kConfig);
  const sim::ModelPtr plant = sim::compile(sim::to_mjcf(config));
  const sim::DataPtr data(mj_makeData(plant.get()));
  sim::Random random(1, 1);
  int on_robot = 0, on_floor = 0;
  for (int sample = 0; sample < 500; ++sample) {
    for (const JointConfig& joint : config.robot.joints) {
      const int id = mj_name2id(plant.get(), mjOBJ_JOINT, joint.name.c_str());
      const double low = plant->jnt_range[2 * id], high = plant->jnt_range[2 * id + 1];
      data->qpos[plant->jnt_qposadr[id]] = low + random.uniform() * (high - low);
    }
    mj_forward(plant.get(), data.get());
    for (int i = 0; i < data->ncon; ++i) {
      const auto link = [&](int geom) {
        return std::string(mj_id2name(plant.get(), mjOBJ_BODY, plant->geom_bodyid[geom]));
      };
      const std::string a = link(data->contact[i].geom1), b = link(data->contact[i].geom2);
      const auto is = [&](const char* x, const char* y) {
        return (a == x && b == y) || (a == y && b == x);
      };
      on_robot += is("FOREARM", "base") || is("hand", "base");
      on_floor += is("FOREARM", "world") || is("hand", "world");
      EXPECT_FALSE(is("base", "SHOULDER") || is("FOREARM", "WRIST_1") ||
                   is("base", "wheel_left_link"))
          << a << " " << b;
      for (const auto& [x, y] : config.robot.contact_excluded)
        EXPECT_FALSE(is(x.c_str(), y.c_str())) << x << " " << y;
    }
  }
  EXPECT_GT(on_robot, 10);
  EXPECT_GT(on_floor, 10);
}

TEST(SimPlant, KinematicsAreThoseOfTheControllersModel) {
  SimDriver sim(sim_config("spawn: {x_m: -1.0, y_m: -0.8, yaw_rad: 0.7, posture: ready}"));
  const RobotModel model = make_model();
  const wb_readings readings = sim.read();
  const Eigen::Isometry3d X_SB = isometry(sim.truth().base_pose(sim.get()));
  double x[kMaxStates] = {0, 0, 0};
  for (int i = 0; i < model.joints(); ++i) x[3 + i] = readings.joints[i].position;
  RobotModel::Data data;
  model.forward_kinematics(x, data);
  for (const char* link : {"end_effector", "camera_shoulder", "FOREARM", "imu_link"}) {
    wb_sim_pose pose{};
    ASSERT_EQ(sim.truth().link_pose(sim.get(), link, &pose), WB_OK);
    const Eigen::Isometry3d X_BL = model.X_WF(model.frame(link), data);
    // Encoder noise of 1e-4 rad on six joints at 1.5 m of reach, four sigma.
    EXPECT_LT(((X_SB * X_BL).translation() - isometry(pose).translation()).norm(), 1.5e-3) << link;
  }
}

TEST(SimPlant, DrivesStraightOnVelocityCommands) {
  SimDriver sim(sim_config(kSpawn));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  const std::vector<double>& q = model.config().stowed;
  sim.run(3.0, [&](TimeNs) { return commands(model, q.data(), 0.3, 0); });
  const Eigen::Isometry3d X = isometry(sim.truth().spawn_pose(sim.get())).inverse() *
                              isometry(sim.truth().base_pose(sim.get()));
  EXPECT_NEAR(X.translation().x(), 0.9, 0.02);  // 0.1 s of run-up at 0.3 m/s is 1.5 cm
  EXPECT_NEAR(X.translation().y(), 0.0, 0.005);
  // Wheel odometry against the truth: slip only.
  const wb_readings r = sim.read();
  const double rolled =
      0.5 * 0.1 * (r.joints[sim.arm()].position + r.joints[sim.arm() + 1].position);
  EXPECT_NEAR(rolled, X.translation().x(), 0.005);
}

TEST(SimPlant, TurnsOnVelocityCommands) {
  SimDriver sim(sim_config(kSpawn));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  const std::vector<double>& q = model.config().stowed;
  sim.run(3.0, [&](TimeNs) { return commands(model, q.data(), 0, 0.5); });
  const Eigen::Isometry3d X = isometry(sim.truth().spawn_pose(sim.get())).inverse() *
                              isometry(sim.truth().base_pose(sim.get()));
  EXPECT_NEAR(std::atan2(X(1, 0), X(0, 0)), 1.5, 0.05);
  EXPECT_LT(X.translation().norm(), 0.01);
  EXPECT_NEAR(sim.read().imu.gyro[2], 0.5, 0.02);  // ten sigma of its noise
}

TEST(SimPlant, ArmHoldsItsPostureOnGravityFeedForward) {
  SimDriver sim(sim_config("spawn: {x_m: -1.0, y_m: -0.8, yaw_rad: 0.0, posture: ready}"));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  const std::vector<double>& q = model.config().ready;
  sim.run(2.0, [&](TimeNs) { return commands(model, q.data(), 0, 0); });
  const wb_readings r = sim.read();
  for (int i = 0; i < model.joints(); ++i) EXPECT_NEAR(r.joints[i].position, q[i], 2e-3) << i;
}

TEST(SimPlant, WristSensorShowsTheHandsWeightAndWhatPushesIt) {
  SimDriver sim(sim_config("spawn: {x_m: -1.0, y_m: -0.8, yaw_rad: 0.0, posture: ready}"));
  const RobotModel model = make_model();
  sim.advance(from_seconds(0.5));
  const auto force_S = [&] {
    wb_sim_pose X_SE{};
    sim.truth().link_pose(sim.get(), "end_effector", &X_SE);
    return Vector3d(isometry(X_SE).linear() * Eigen::Map<const Vector3d>(sim.read().wrench.force));
  };
  Vector3d com;
  const double weight = 9.81 * model.mass_beyond(model.frame("hand"), com);
  constexpr double kTolerance_n = 0.5;  // five sigma of the noise
  EXPECT_LT((force_S() - Vector3d(0, 0, -weight)).norm(), kTolerance_n);
  const double push[3] = {10, -5, 3}, none[3] = {0, 0, 0};
  sim.fault().push(sim.get(), "hand", push, none);
  sim.advance(from_seconds(1.0));
  EXPECT_LT((force_S() - Vector3d(10, -5, 3 - weight)).norm(), kTolerance_n);
}

TEST(SimPlant, AccelerometerShowsGravityUpwards) {
  SimDriver sim(sim_config(kSpawn));
  sim.advance(from_seconds(0.5));
  const wb_readings r = sim.read();
  EXPECT_NEAR(r.imu.acceleration[0], 0.0, 0.12);  // five sigma, and a lean of 2 mrad
  EXPECT_NEAR(r.imu.acceleration[1], 0.0, 0.12);
  EXPECT_NEAR(r.imu.acceleration[2], 9.81, 0.1);
}

TEST(SimPlant, GripperClosesAtItsSpeedAndOpensAgain) {
  SimDriver sim(sim_config(kSpawn));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  EXPECT_NEAR(sim.read().gripper.opening, 0.08, 1e-3);
  wb_commands c = commands(model, model.config().stowed.data(), 0, 0);
  c.gripper.opening = 0.02;
  sim.run(0.15, [&](TimeNs) { return c; });
  EXPECT_NEAR(sim.read().gripper.opening, 0.05, 0.005);  // two fingers at 0.1 m/s
  sim.run(0.35, [&](TimeNs) { return c; });
  EXPECT_NEAR(sim.read().gripper.opening, 0.02, 1e-3);
  c.gripper.opening = 0.08;
  sim.run(0.5, [&](TimeNs) { return c; });
  EXPECT_NEAR(sim.read().gripper.opening, 0.08, 1e-3);
}

TEST(SimPlant, RefusesCommandsThatAreNotFinite) {
  SimDriver sim(sim_config(kSpawn));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  wb_commands c = commands(model, model.config().stowed.data(), 0, 0);
  c.joints[2].stiffness = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(sim.write(c), WB_ERROR);
}

TEST(SimPlant, TimeOutHaltsTheJointsAndIsLatchedUntilActivation) {
  SimDriver sim(sim_config("spawn: {x_m: -1.5, y_m: -0.8, yaw_rad: 0.0, posture: ready}"));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  std::vector<double> q = model.config().ready;
  const auto drive = [&](TimeNs t) {
    wb_commands c = commands(model, q.data(), 0.5, 0);
    c.joints[0].position += 0.4 * to_seconds(t);
    return c;
  };
  sim.run(1.0, drive);
  EXPECT_GT(std::abs(sim.read().joints[0].velocity), 0.2);
  sim.advance(50 * kTick);  // 125 ms without a write: 50 ms of grace, then 75 ms to halt
  const wb_readings halted = sim.read();
  EXPECT_TRUE(halted.timed_out);
  EXPECT_EQ(sim.write(drive(sim.now())), WB_TIMED_OUT);
  sim.advance(from_seconds(1.0));
  const wb_readings later = sim.read();
  for (int i = 0; i < sim.arm() + 2; ++i) EXPECT_NEAR(later.joints[i].velocity, 0, 0.02) << i;
  EXPECT_EQ(sim.write(drive(sim.now())), WB_TIMED_OUT);

  // Activating again moves nothing: the joints stay where they are until the first write, with or
  // without time-out.
  ASSERT_EQ(sim.api().deactivate(sim.get()), WB_OK);
  ASSERT_EQ(sim.activate(), WB_OK);
  sim.advance(from_seconds(1.0));
  const wb_readings again = sim.read();
  EXPECT_FALSE(again.timed_out);
  for (int i = 0; i < sim.arm() + 2; ++i)
    EXPECT_NEAR(again.joints[i].position, later.joints[i].position, 2e-3) << i;
  for (std::size_t i = 0; i < q.size(); ++i) q[i] = again.joints[i].position;
  EXPECT_EQ(sim.write(commands(model, q.data(), 0, 0)), WB_OK);
}

TEST(SimPlant, StopActsAtOnceAndDampedArmDoesNotDrop) {
  SimDriver sim(sim_config("spawn: {x_m: -1.5, y_m: -0.8, yaw_rad: 0.0, posture: ready}"));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(WB_TIMEOUT_DAMPED), WB_OK);
  const wb_commands c = commands(model, model.config().ready.data(), 0, 0);
  sim.run(0.5, [&](TimeNs) { return c; });
  EXPECT_EQ(sim.api().stop(sim.get()), WB_OK);
  EXPECT_EQ(sim.write(c), WB_TIMED_OUT);
  sim.advance(from_seconds(2.0));
  const wb_readings r = sim.read();
  EXPECT_TRUE(r.timed_out);
  for (int i = 0; i < sim.arm(); ++i)
    EXPECT_NEAR(r.joints[i].position, model.config().ready[i], 0.02) << i;
}

TEST(SimPlant, PositionTargetsAreClippedToTheJointsLimits) {
  SimDriver sim(sim_config("spawn: {x_m: -1.5, y_m: -0.8, yaw_rad: 0.0, posture: ready}"));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  wb_commands c = commands(model, model.config().ready.data(), 0, 0);
  const double upper = sim.description().joints[5].position_max;
  sim.run(3.0, [&](TimeNs t) {
    c.joints[5].position =
        model.config().ready[5] + 2.0 * to_seconds(t);  // ends far beyond the limit
    return c;
  });
  EXPECT_NEAR(sim.read().joints[5].position, upper, 0.02);
  EXPECT_LT(std::abs(sim.read().joints[5].effort),
            5.0);  // it does not lean on the stop: 40 Nm if it did
}

TEST(SimPlant, AHungOrSilentDriverIsSeenByItsHost) {
  SimDriver sim(sim_config(kSpawn));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  const wb_commands c = commands(model, model.config().stowed.data(), 0, 0);
  sim.run(0.1, [&](TimeNs) { return c; });
  sim.fault().freeze(sim.get(), 1);
  const TimeNs stamp = sim.read().t_ns;
  sim.run(0.1, [&](TimeNs) { return c; });
  EXPECT_EQ(sim.read().t_ns, stamp);
  EXPECT_EQ(sim.read().joints[0].age_ns, from_seconds(0.1));
  EXPECT_TRUE(sim.read().timed_out);
  sim.fault().freeze(sim.get(), 0);
  EXPECT_EQ(sim.read().t_ns, sim.now());
  EXPECT_FALSE(sim.read().emergency_stop);
  sim.fault().emergency_stop(sim.get(), 1);
  EXPECT_TRUE(sim.read().emergency_stop);
  sim.fault().stop_answering(sim.get(), 1);
  wb_readings r{};
  EXPECT_EQ(sim.api().read(sim.get(), &r), WB_ERROR);
  EXPECT_EQ(sim.api().write(sim.get(), &c), WB_ERROR);
}

TEST(SimPlant, PortsDoNotAllocate) {
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns malloc";
  SimDriver sim(sim_config(kSpawn + ", colour: true"));
  const RobotModel model = make_model();
  ASSERT_EQ(sim.activate(), WB_OK);
  const wb_commands c = commands(model, model.config().stowed.data(), 0.2, 0.1);
  wb_readings r{};
  wb_frame frame{};
  constexpr int kTicks = 200;
  int frames = 0;
  std::uint64_t in_advance = 0;
  const std::uint64_t before = thread_allocations();
  for (int tick = 0; tick < kTicks; ++tick) {
    const std::uint64_t here = thread_allocations();
    sim.advance(kTick);
    in_advance += thread_allocations() - here;
    sim.api().read(sim.get(), &r);
    sim.api().write(sim.get(), &c);
    while (sim.api().acquire_frame(sim.get(), &frame) == WB_OK) {
      ++frames;
      sim.api().release_frame(sim.get(), frame.token);
    }
  }
  sim.api().stop(sim.get());
  EXPECT_EQ(thread_allocations() - before, in_advance);
  // One in each physics step is glibc's: MuJoCo's broad phase sorts more than the kilobyte that
  // qsort keeps on the stack.
  EXPECT_LE(in_advance, static_cast<std::uint64_t>(kTicks));
  EXPECT_GT(frames, 0);
}

TEST(SimPlant, StatesFollowTheLifeCycle) {
  SimDriver sim(sim_config(kSpawn));
  const wb_commands c{};
  EXPECT_EQ(sim.api().configure(sim.get()), WB_BAD_STATE);
  EXPECT_EQ(sim.write(c), WB_BAD_STATE);
  EXPECT_EQ(sim.api().stop(sim.get()), WB_BAD_STATE);
  EXPECT_EQ(sim.activate(), WB_OK);
  EXPECT_EQ(sim.activate(), WB_BAD_STATE);
  EXPECT_EQ(sim.api().deactivate(sim.get()), WB_OK);
  EXPECT_EQ(sim.write(c), WB_BAD_STATE);
}

}  // namespace
}  // namespace wb
