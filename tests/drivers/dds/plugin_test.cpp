// The plugin against a low-level computer in this process, real time.
#include <cmath>
#include <limits>

#include "core/rt/allocation_count.hpp"
#include "tests/drivers/dds/dds_fixture.hpp"

namespace wb::dds {
namespace {

using PluginTest = DdsDriverTest;

TEST_F(PluginTest, DescribesTheRobotsPartsThatItTakes) {
  start();
  const wb_description& d = plugin->description;
  ASSERT_EQ(d.joint_count, 5u);
  EXPECT_STREQ(d.joints[3].name, "wheel_0");
  EXPECT_EQ(d.joints[3].is_wheel, 1u);
  EXPECT_DOUBLE_EQ(d.joints[0].position_max, 2);
  EXPECT_EQ(d.joints[0].command_kinds, (1u << WB_CMD_IMPEDANCE) | (1u << WB_CMD_VELOCITY));
  EXPECT_EQ(d.has_imu + d.has_wrench + d.has_gripper + d.has_emergency_stop, 4u);
  EXPECT_EQ(d.can_step, 0u);
  EXPECT_EQ(plugin->advance(0), WB_BAD_STATE);
}

TEST_F(PluginTest, ReadsWhatTheRobotMeasures) {
  start();
  robot().set_position(1, 0.75);
  ASSERT_TRUE(wait_until(
      [&] { return plugin->read() == WB_OK && plugin->readings.joints[1].position == 0.75; }));
  const wb_readings& r = plugin->readings;
  EXPECT_TRUE(r.joints[0].valid);
  EXPECT_DOUBLE_EQ(r.imu.gyro[2], 0.03);
  EXPECT_DOUBLE_EQ(r.imu.acceleration[2], 9.81);
  EXPECT_DOUBLE_EQ(r.wrench.force[1], 2);
  EXPECT_DOUBLE_EQ(r.wrench.torque[2], 0.3);
  EXPECT_DOUBLE_EQ(r.gripper.opening, 0.04);
  // The host's clock is the monotonic one.
  EXPECT_LT(std::abs(to_seconds(clock_ns(CLOCK_MONOTONIC) - r.t_ns)), 1.0);
}

TEST_F(PluginTest, EachJointHasItsOwnAgeStatusAndErrorCode) {
  start();
  robot().age_joint(2, 70'000'000);
  robot().fail_joint(0, 0x8130);
  ASSERT_TRUE(wait_until([&] {
    return plugin->read() == WB_OK && plugin->readings.joints[0].error_code == 0x8130 &&
           plugin->readings.joints[2].age_ns >= 70'000'000;
  }));
  EXPECT_TRUE(plugin->readings.joints[1].valid);
  EXPECT_LT(plugin->readings.joints[1].age_ns, plugin->readings.joints[2].age_ns);
  EXPECT_EQ(plugin->readings.joints[0].status, WB_JOINT_FAULT);
  EXPECT_EQ(plugin->readings.joints[1].status, WB_JOINT_DISABLED);
  EXPECT_GT(plugin->readings.joints[1].quality, 0);
  EXPECT_LE(plugin->readings.joints[1].quality, 1);
}

TEST_F(PluginTest, NothingMovesThatWasNotCommanded) {
  start();
  EXPECT_EQ(plugin->write(velocity_commands(5, 1)), WB_BAD_STATE);
  ASSERT_EQ(plugin->activate(), WB_OK);
  let_work();
  EXPECT_EQ(robot().travel(), 0) << "activation alone moved something";
  wb_commands one{};
  one.joints[1].kind = WB_CMD_VELOCITY;
  one.joints[1].velocity = 0.5;
  ASSERT_TRUE(write_until(one, [&] { return robot().position(1) > 0.05; }));
  for (const int still : {0, 2, 3, 4}) EXPECT_EQ(robot().position(still), 0) << still;
}

TEST_F(PluginTest, CommandsArriveWithinTheJointsLimits) {
  start();
  ASSERT_EQ(plugin->activate(), WB_OK);
  wb_commands c{};
  c.joints[0] = {WB_CMD_IMPEDANCE, 9, -9, 99, 30, 3};
  c.joints[3] = {WB_CMD_VELOCITY, 0, 100, 0, 0, 0};
  c.gripper.opening = 0.02;
  c.gripper.force = 10;
  ASSERT_TRUE(write_until(c, [&] { return robot().applied() > 0; }));
  const wb_commands got = robot().commands();
  EXPECT_DOUBLE_EQ(got.joints[0].position, 2);
  EXPECT_DOUBLE_EQ(got.joints[0].velocity, -1.5);
  EXPECT_DOUBLE_EQ(got.joints[0].effort, 20);
  EXPECT_DOUBLE_EQ(got.joints[0].stiffness, 30);
  EXPECT_DOUBLE_EQ(got.joints[3].velocity, 1.5);
  EXPECT_DOUBLE_EQ(got.gripper.opening, 0.02);
}

TEST_F(PluginTest, NonFiniteCommandsAreRefused) {
  start();
  ASSERT_EQ(plugin->activate(), WB_OK);
  wb_commands c = velocity_commands(5, 0);
  c.joints[2].velocity = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(plugin->write(c), WB_ERROR);
}

TEST_F(PluginTest, BothSidesStopWhenWritesCeaseAndStayStoppedUntilActivated) {
  start();
  ASSERT_EQ(plugin->activate(300'000'000, WB_TIMEOUT_BRAKE), WB_OK);
  ASSERT_TRUE(write_until(velocity_commands(5, 0.1), [&] { return robot().travel() > 0; }));
  ASSERT_TRUE(wait_until([&] { return robot().stops() > 0; }));
  EXPECT_EQ(robot().stop_action(4), WB_TIMEOUT_BRAKE);
  ASSERT_TRUE(wait_until([&] { return plugin->read() == WB_OK && plugin->readings.timed_out; }));
  EXPECT_TRUE(wait_until([&] {
    return plugin->read() == WB_OK && plugin->readings.joints[0].status == WB_JOINT_STOPPED;
  }));
  const double there = robot().travel();
  EXPECT_EQ(plugin->write(velocity_commands(5, 0.1)), WB_TIMED_OUT);
  let_work();
  EXPECT_EQ(robot().travel(), there);
  ASSERT_EQ(plugin->deactivate(), WB_OK);
  ASSERT_EQ(plugin->activate(), WB_OK);
  EXPECT_TRUE(write_until(velocity_commands(5, 0.1), [&] { return robot().travel() > there; }));
}

TEST_F(PluginTest, StopIsPassedOnAndLatched) {
  start();
  ASSERT_EQ(plugin->activate(900'000'000), WB_OK);
  ASSERT_TRUE(write_until(velocity_commands(5, 0.1), [&] { return robot().travel() > 0; }));
  EXPECT_EQ(plugin->api().stop(plugin->get()), WB_OK);
  EXPECT_EQ(plugin->write(velocity_commands(5, 0.1)), WB_TIMED_OUT);
  EXPECT_TRUE(wait_until([&] { return robot().stops() == 1; }));
  EXPECT_EQ(low_level->low_level.counts().time_outs, 0u) << "it was the message that stopped it";
}

TEST_F(PluginTest, DeactivationStopsTheJoints) {
  start();
  ASSERT_EQ(plugin->activate(900'000'000), WB_OK);
  ASSERT_TRUE(write_until(velocity_commands(5, 0.1), [&] { return robot().travel() > 0; }));
  ASSERT_EQ(plugin->deactivate(), WB_OK);
  EXPECT_EQ(robot().stops(), 1);  // acknowledged before deactivate() returned
}

TEST_F(PluginTest, EmergencyStopIsPassedOnAndStopsTheJoints) {
  start();
  ASSERT_EQ(plugin->activate(900'000'000), WB_OK);
  ASSERT_TRUE(write_until(velocity_commands(5, 0.1), [&] { return robot().travel() > 0; }));
  robot().press_emergency_stop(true);
  ASSERT_TRUE(
      wait_until([&] { return plugin->read() == WB_OK && plugin->readings.emergency_stop; }));
  EXPECT_EQ(robot().stops(), 1);
  EXPECT_TRUE(wait_until([&] { return plugin->read() == WB_OK && plugin->readings.timed_out; }));
}

TEST_F(PluginTest, ASecondCommanderIsRefusedWithTheHoldersName) {
  start();
  Plugin second(config());
  ASSERT_EQ(plugin->activate(), WB_OK);
  EXPECT_EQ(second.activate(), WB_ERROR);
  EXPECT_NE(second.log().find("held by wb_driver_dds on "), std::string::npos) << second.log();
  EXPECT_NE(second.log().find("process " + std::to_string(getpid())), std::string::npos);
  ASSERT_EQ(second.read(), WB_OK) << "it may still look";
  ASSERT_EQ(plugin->deactivate(), WB_OK);
  EXPECT_EQ(second.activate(), WB_OK);
}

TEST_F(PluginTest, ALeaseThatEndedElsewhereStopsThePlugin) {
  start();
  ASSERT_EQ(plugin->activate(900'000'000), WB_OK);
  ASSERT_TRUE(write_until(velocity_commands(5, 0.1), [&] { return robot().travel() > 0; }));
  low_level.reset();  // and comes back, knowing nothing of the lease
  start_low_level();
  EXPECT_TRUE(wait_until([&] { return plugin->count("lease.lost") == 1; }));
  ASSERT_TRUE(wait_until([&] { return plugin->read() == WB_OK; }));
  EXPECT_TRUE(plugin->readings.timed_out);
  EXPECT_EQ(plugin->write(velocity_commands(5, 0.1)), WB_TIMED_OUT);
  EXPECT_EQ(robot().travel(), 0);
  ASSERT_EQ(plugin->deactivate(), WB_OK);
  ASSERT_EQ(plugin->activate(), WB_OK);
  EXPECT_TRUE(write_until(velocity_commands(5, 0.1), [&] { return robot().travel() > 0; }));
}

TEST_F(PluginTest, NoLeaseWithoutAnAnswer) {
  start();
  low_level->low_level.faults.deaf = true;
  EXPECT_EQ(plugin->activate(), WB_ERROR);
  EXPECT_NE(plugin->log().find("does not answer"), std::string::npos) << plugin->log();
}

TEST_F(PluginTest, ASilentRobotIsAnErrorAndComesBack) {
  start();
  ASSERT_EQ(plugin->read(), WB_OK);
  low_level->low_level.faults.silent = true;
  EXPECT_TRUE(wait_until([&] { return plugin->read() == WB_ERROR; }));
  low_level->low_level.faults.silent = false;
  EXPECT_TRUE(wait_until([&] { return plugin->read() == WB_OK; }));
}

struct FaultCase {
  const char* name;
  std::atomic<bool> LowLevelFaults::*fault;
  const char* counter;
};

class FaultySamples : public DdsDriverTest, public ::testing::WithParamInterface<FaultCase> {};

TEST_P(FaultySamples, AreCountedByKindAndDropped) {
  start();
  low_level->low_level.faults.*GetParam().fault = true;
  EXPECT_TRUE(wait_until([&] { return plugin->count(GetParam().counter) >= 5; }));
  low_level->low_level.faults.*GetParam().fault = false;
  EXPECT_TRUE(wait_until([&] { return plugin->read() == WB_OK; }));
}

INSTANTIATE_TEST_SUITE_P(
    EachKind, FaultySamples,
    ::testing::Values(FaultCase{"Old", &LowLevelFaults::old_stamps, "samples.stale"},
                      FaultCase{"Future", &LowLevelFaults::future_stamps, "samples.future"},
                      FaultCase{"Duplicate", &LowLevelFaults::duplicate, "samples.duplicate"},
                      FaultCase{"Reordered", &LowLevelFaults::reorder, "samples.out_of_order"},
                      FaultCase{"Frozen", &LowLevelFaults::frozen, "samples.frozen"}),
    [](const auto& info) { return info.param.name; });

TEST_F(PluginTest, JointsMayBeAPartInAnotherOrder) {
  start_low_level();
  plugin = std::make_unique<Plugin>("{domain: " + std::to_string(domain()) +
                                    ", prefix: robot, clock: ros, joints: [wheel_1, joint_0]}");
  ASSERT_EQ(plugin->description.joint_count, 2u);
  EXPECT_EQ(plugin->description.has_gripper, 0u);
  ASSERT_EQ(plugin->activate(), WB_OK);
  ASSERT_TRUE(write_until(velocity_commands(2, 0.3), [&] { return robot().position(4) > 0.01; }));
  EXPECT_GT(robot().position(0), 0);
  for (const int still : {1, 2, 3}) EXPECT_EQ(robot().position(still), 0) << still;
  EXPECT_EQ(robot().readings().gripper.opening, 0.04);
}

TEST_F(PluginTest, AStartWithoutTheRobotSaysWhatIsMissing) {
  try {
    Plugin lonely(config(false, ", connect_timeout_ms: 200"));
    FAIL() << "it started";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("rt/robot/robot_description"), std::string::npos)
        << error.what();
  }
  start_low_level();
  try {
    Plugin wrong("{domain: " + std::to_string(domain()) +
                 ", prefix: robot, clock: ros, joints: [elbow]}");
    FAIL() << "it started";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("has no joint 'elbow'"), std::string::npos)
        << error.what();
  }
}

TEST_F(PluginTest, PortsDoNotAllocate) {
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns malloc";
  start();
  ASSERT_EQ(plugin->activate(), WB_OK);
  const wb_commands c = velocity_commands(5, 0.1);
  ASSERT_TRUE(write_until(c, [&] { return robot().applied() > 0; }));
  const std::uint64_t before = thread_allocations();
  for (int i = 0; i < 50; ++i) {
    plugin->read();
    plugin->write(c);
    wb_frame frame;
    plugin->api().acquire_frame(plugin->get(), &frame);
  }
  plugin->api().stop(plugin->get());
  EXPECT_EQ(thread_allocations(), before);
}

}  // namespace
}  // namespace wb::dds
