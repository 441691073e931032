// The driver host over fake plugins that follow a script: what it refuses at setup, how it maps and
// adapts, and which troubles become a driver fault.
#include "drivers/driver_host.hpp"

#include <gtest/gtest.h>

#include <map>

#include "control/command_gate.hpp"
#include "core/config/config.hpp"
#include "tests/drivers/fake/fake_driver.h"

namespace wb {
namespace {

constexpr TimeNs kTick = 2'500'000;

const std::shared_ptr<const RobotModel>& mabi() {
  static const auto model = std::make_shared<const RobotModel>(
      RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile"));
  return model;
}

PluginSpec fake(const std::string& config, wb_command_kind command = WB_CMD_NONE) {
  return {WB_FAKE, config, ".", command};
}

const std::string kArm = "joints: [SH_ROT, SH_FLE, EL_FLE, EL_ROT, WR_FLE, WR_ROT]";
const std::string kWheels = "wheels: [wheel_left, wheel_right]";
std::string arm(const std::string& more = "") { return "{name: arm, " + kArm + more + "}"; }
std::string wheels(const std::string& more = "") { return "{name: base, " + kWheels + more + "}"; }
std::string both(const std::string& more = "") {
  return "{name: robot, " + kArm + ", " + kWheels + more + "}";
}

std::string refusal(const std::vector<PluginSpec>& plugins, std::string* logged = nullptr) {
  try {
    DriverHost host(mabi()->config(), plugins, [&](wb_log_level level, const std::string& text) {
      if (logged && level == WB_LOG_ERROR) *logged = text;
    });
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

struct Rig {
  explicit Rig(const std::vector<PluginSpec>& plugins)
      : host(mabi()->config(), plugins,
             [this](wb_log_level, const std::string& text) { log = text; }),
        gate(mabi()) {
    gate.reset(q.data());
  }

  wb_fake_script& script(const std::string& name) {
    const void* s = host.extension(("wb.fake/" + name).c_str(), nullptr);
    if (!s) throw std::runtime_error("no fake " + name);
    return *static_cast<wb_fake_script*>(const_cast<void*>(s));
  }
  const Readings& read() {
    host.read(now += kTick, readings);
    return readings;
  }
  // A command of the gate on its way to position 1 rad; wheels roll.
  SafeCommand write() {
    Command c;
    c.t_ns = now;
    c.joint_count = mabi()->joints();
    c.wheel_count = 2;
    for (int i = 0; i < c.joint_count; ++i)
      c.joints[i] = {CommandKind::kImpedance, 1.0, 0.0, 2.0 + i, 50.0, 5.0};
    for (int i = 0; i < 2; ++i) c.wheels[i] = {CommandKind::kVelocity, 0, 1.0 + i, 0, 0, 0};
    c.gripper = {0.05, 20.0};
    const SafeCommand safe = gate.step(c, now, to_seconds(kTick), Mode::kActive);
    host.write(safe);
    return safe;
  }
  std::map<std::string, std::uint64_t> counters() {
    std::vector<std::uint64_t> values(host.counter_names().size());
    host.read_counters(values.data());
    std::map<std::string, std::uint64_t> out;
    for (std::size_t i = 0; i < values.size(); ++i) out[host.counter_names()[i]] = values[i];
    return out;
  }

  std::string log;
  DriverHost host;
  CommandGate gate;
  std::array<double, kMaxJoints> q{};
  Readings readings;
  TimeNs now = 0;
};

TEST(DriverHost, RefusesAPluginOfAnotherAbiNamingBothNumbers) {
  EXPECT_EQ(refusal({{WB_FAKE_ABI2, both(), ".", WB_CMD_NONE}}),
            "driver " WB_FAKE_ABI2 " has ABI 2, this program has 1");
}

TEST(DriverHost, RefusesAnInterfaceOfAnotherSizeNamingBothSizes) {
  EXPECT_EQ(refusal({{WB_FAKE_SHORT, both(), ".", WB_CMD_NONE}}),
            "driver " WB_FAKE_SHORT " has an interface of 8 bytes, ABI 1 has " +
                std::to_string(sizeof(wb_driver_api)));
}

TEST(DriverHost, RefusesALibraryThatIsNotThere) {
  EXPECT_TRUE(contains(refusal({{"/nowhere/libwb_driver_x.so", "{}", ".", WB_CMD_NONE}}),
                       "driver /nowhere/libwb_driver_x.so cannot be loaded"));
}

TEST(DriverHost, RefusesAConfigurationThatThePluginRefusesAndForwardsItsLogLine) {
  std::string logged;
  const std::string text = refusal({fake("{name: a, no_such_key: 1}")}, &logged);
  EXPECT_TRUE(contains(text, "could not be created")) << text;
  EXPECT_TRUE(contains(logged, "no_such_key")) << logged;
}

TEST(DriverHost, RefusesAJointWithoutDriverAndOneWithTwoNamingThem) {
  EXPECT_EQ(refusal({fake(arm())}), "joint wheel_left of robot mabi_mobile has no driver");
  EXPECT_EQ(refusal({fake(both()), fake("{name: other, joints: [EL_FLE]}")}),
            "joint EL_FLE of robot mabi_mobile has two drivers: fake and fake_2");
}

TEST(DriverHost, RefusesAJointWhoseKindsTheControllerCannotUse) {
  EXPECT_EQ(refusal({fake(both(", kinds: [velocity]"))}),
            "joint SH_ROT supports velocity, the controller needs impedance, position or torque");
  EXPECT_EQ(refusal({fake(both(", wheel_kinds: [torque]"))}),
            "joint wheel_left supports torque, a wheel needs velocity");
}

TEST(DriverHost, RefusesTwoProvidersOfASensorOrGripperNamingBoth) {
  for (const auto& [key, what] :
       std::map<std::string, std::string>{{"imu", "an IMU"},
                                          {"wrench", "a wrench sensor"},
                                          {"gripper", "a gripper"},
                                          {"emergency_stop", "an emergency stop"}}) {
    const std::string more = ", sensors: [" + key + "]";
    EXPECT_EQ(refusal({fake(arm(more)), fake(wheels(more))}),
              "robot mabi_mobile has two drivers with " + what + ": fake and fake_2");
  }
}

TEST(DriverHost, RefusesACameraOfAnotherSizeThanInRobotYaml) {
  EXPECT_EQ(refusal({fake(both(", camera: {name: camera_front, width: 320, height: 240}"))}),
            "camera camera_front of driver fake has 320 x 240 pixels, in robot.yaml 160 x 120 "
            "pixels");
}

TEST(DriverHost, RefusesACounterWhoseNameTheStatusCannotShow) {
  EXPECT_TRUE(contains(refusal({fake(both(", counters: [a_name_that_is_longer_than_31]"))}),
                       "a counter with too long a name"));
}

TEST(DriverHost, TakesEachSensorFromThePluginThatHasIt) {
  Rig rig({fake(arm(", sensors: [wrench]")), fake(wheels(", sensors: [imu]")),
           fake("{name: hand, sensors: [gripper, emergency_stop]}")});
  rig.script("arm").readings.wrench.force[2] = 7.0;
  rig.script("base").readings.imu.gyro[1] = 0.5;
  rig.script("hand").readings.gripper.opening = 0.03;
  // One that did not describe a gripper is not asked.
  rig.script("arm").readings.gripper = {0.9, 9.0, 1};
  const Readings& r = rig.read();
  EXPECT_TRUE(r.wrench_valid && r.imu_valid && r.gripper_valid);
  EXPECT_EQ(r.wrench[2], 7.0);
  EXPECT_EQ(r.gyro[1], 0.5);
  EXPECT_EQ(r.gripper_opening_m, 0.03);
  EXPECT_FALSE(r.emergency_stop);
  rig.script("hand").readings.emergency_stop = 1;
  EXPECT_TRUE(rig.read().emergency_stop);
}

TEST(DriverHost, GivesEachJointToItsOwnPluginAndTheGripperToTheOneThatHasIt) {
  Rig rig({fake(wheels()), fake(arm(", sensors: [gripper]"))});
  ASSERT_TRUE(rig.host.activate(50'000'000));
  rig.read();
  const Command c = rig.write().get();
  const wb_commands& base = rig.script("base").commands;
  const wb_commands& joints = rig.script("arm").commands;
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(base.joints[i].kind, WB_CMD_VELOCITY);
    EXPECT_EQ(base.joints[i].velocity, c.wheels[i].velocity);
  }
  EXPECT_GT(base.joints[1].velocity, 0.0);
  for (int i = 0; i < c.joint_count; ++i) {
    EXPECT_EQ(joints.joints[i].kind, WB_CMD_IMPEDANCE);
    EXPECT_EQ(joints.joints[i].position, c.joints[i].position);
    EXPECT_EQ(joints.joints[i].effort, 2.0 + i);
    EXPECT_EQ(joints.joints[i].stiffness, 50.0);
  }
  EXPECT_EQ(joints.gripper.opening, 0.05);
  EXPECT_EQ(base.gripper.opening, 0.0);
  EXPECT_EQ(joints.t_ns, rig.now);
}

TEST(DriverHost, ComputesTorqueFromTheReadingOfTheSameTickForDrivesThatTakeOnlyTorque) {
  Rig rig({fake(both(", kinds: [torque], effort_max: 1000"))});
  ASSERT_TRUE(rig.host.activate(50'000'000));
  rig.script("robot").readings.joints[3].velocity = -0.2;
  rig.read();
  const Command c = rig.write().get();
  for (int i = 0; i < c.joint_count; ++i) {
    const auto& out = rig.script("robot").commands.joints[i];
    EXPECT_EQ(out.kind, WB_CMD_TORQUE);
    const double dq = i == 3 ? -0.2 : 0.0;
    EXPECT_DOUBLE_EQ(out.effort, 50.0 * (c.joints[i].position - 0.1 * i) +
                                     5.0 * (c.joints[i].velocity - dq) + 2.0 + i);
  }
}

TEST(DriverHost, SendsNoTorqueToAJointWhosePluginDidNotAnswer) {
  Rig rig({fake(both(", kinds: [torque]"))});
  ASSERT_TRUE(rig.host.activate(50'000'000));
  rig.read();
  rig.script("robot").read = WB_ERROR;
  rig.read();
  rig.write();
  for (int i = 0; i < mabi()->joints(); ++i)
    EXPECT_EQ(rig.script("robot").commands.joints[i].kind, WB_CMD_NONE);
}

TEST(DriverHost, AForcedKindAppliesToItsPluginsJointsAndLeavesWheelsAlone) {
  Rig rig({fake(both(", kinds: [impedance, torque, position]"), WB_CMD_POSITION)});
  ASSERT_TRUE(rig.host.activate(50'000'000));
  rig.read();
  rig.write();
  const wb_commands& out = rig.script("robot").commands;
  EXPECT_EQ(out.joints[0].kind, WB_CMD_POSITION);
  EXPECT_EQ(out.joints[6].kind, WB_CMD_VELOCITY);
}

TEST(DriverHost, AForcedKindThatAJointDoesNotSupportIsAConfigurationError) {
  EXPECT_THROW(DriverHost(mabi()->config(), {fake(both(), WB_CMD_TORQUE)}, {}),
               config::ConfigError);
}

TEST(DriverHost, JointStatusErrorCodeAndQualityReachTheReadings) {
  Rig rig({fake(both())});
  auto& joint = rig.script("robot").readings.joints[2];
  joint.status = WB_JOINT_FAULT;
  joint.error_code = 0x8611;
  joint.quality = 0.75;
  const Readings& r = rig.read();
  EXPECT_EQ(r.joints[2].status, JointStatus::kFault);
  EXPECT_EQ(r.joints[2].error_code, 0x8611u);
  EXPECT_EQ(r.joints[2].quality, 0.75);
  EXPECT_EQ(r.joints[0].status, JointStatus::kFollowing);
  joint.status = 77;
  EXPECT_EQ(rig.read().joints[2].status, JointStatus::kUnknown);
}

TEST(DriverHost, AJointInFaultLostOrUnknownIsADriverFaultOnlyWhileActive) {
  for (const std::uint32_t status : {WB_JOINT_FAULT, WB_JOINT_LOST, WB_JOINT_UNKNOWN}) {
    for (const int joint : {1, 7}) {  // 7: a wheel
      Rig rig({fake(both())});
      rig.script("robot").readings.joints[joint].status = status;
      EXPECT_FALSE(rig.read().driver_fault);
      ASSERT_TRUE(rig.host.activate(50'000'000));
      EXPECT_TRUE(rig.read().driver_fault);
      EXPECT_EQ(rig.counters().at("fake.joint_faults"), 1u);
      rig.script("robot").readings.joints[joint].status = WB_JOINT_FOLLOWING;
      EXPECT_FALSE(rig.read().driver_fault);
    }
  }
}

TEST(DriverHost, AJointThatIsStoppedOrDisabledIsNoFaultByItself) {
  Rig rig({fake(both())});
  ASSERT_TRUE(rig.host.activate(50'000'000));
  rig.script("robot").readings.joints[0].status = WB_JOINT_STOPPED;
  rig.script("robot").readings.joints[1].status = WB_JOINT_DISABLED;
  EXPECT_FALSE(rig.read().driver_fault);
}

TEST(DriverHost, AFailedWriteIsCountedAndIsADriverFaultInTheNextReadingOnly) {
  for (const wb_status status : {WB_ERROR, WB_TIMED_OUT}) {
    Rig rig({fake(arm()), fake(wheels())});
    ASSERT_TRUE(rig.host.activate(50'000'000));
    EXPECT_FALSE(rig.read().driver_fault);
    rig.script("base").write = status;
    rig.write();
    EXPECT_EQ(rig.script("arm").writes, 1u);
    rig.script("base").write = WB_OK;
    EXPECT_TRUE(rig.read().driver_fault);
    EXPECT_EQ(rig.counters().at("fake_2.failed_writes"), 1u);
    EXPECT_EQ(rig.counters().at("fake.failed_writes"), 0u);
    EXPECT_FALSE(rig.read().driver_fault);
  }
}

TEST(DriverHost, AFailedReadIsCountedAndInvalidatesOnlyThatPluginsJoints) {
  Rig rig({fake(arm()), fake(wheels())});
  rig.read();
  rig.script("arm").read = WB_ERROR;
  const Readings& r = rig.read();
  EXPECT_TRUE(r.driver_fault);
  EXPECT_FALSE(r.joints[0].valid);
  EXPECT_TRUE(r.wheels[0].valid);
  EXPECT_EQ(rig.counters().at("fake.failed_reads"), 1u);
}

TEST(DriverHost, ThePluginsOwnTimeOutIsADriverFaultWhileActive) {
  Rig rig({fake(both())});
  rig.script("robot").readings.timed_out = 1;
  EXPECT_FALSE(rig.read().driver_fault);
  ASSERT_TRUE(rig.host.activate(50'000'000));
  EXPECT_TRUE(rig.read().driver_fault);
}

TEST(DriverHost, OnePluginThatFailsToActivateDeactivatesAllAndIsADriverFault) {
  Rig rig({fake(arm()), fake(wheels())});
  rig.script("base").activate = WB_ERROR;
  EXPECT_FALSE(rig.host.activate(50'000'000));
  EXPECT_FALSE(rig.host.active());
  EXPECT_EQ(rig.script("arm").activations, 1u);
  EXPECT_EQ(rig.script("arm").state, WB_INACTIVE);
  EXPECT_EQ(rig.log, "driver fake_2 could not be activated");
  EXPECT_TRUE(rig.read().driver_fault);
  rig.write();
  EXPECT_EQ(rig.script("arm").writes, 0u);
  rig.script("base").activate = WB_OK;
  EXPECT_TRUE(rig.host.activate(50'000'000));
  EXPECT_FALSE(rig.read().driver_fault);
}

TEST(DriverHost, HandsTheTimeOutAndItsActionToEachJoint) {
  Rig rig({fake(both())});
  ASSERT_TRUE(rig.host.activate(40'000'000));
  EXPECT_EQ(rig.script("robot").timeout_ns, 40'000'000);
  EXPECT_EQ(rig.script("robot").actions[5], WB_TIMEOUT_HOLD);
  EXPECT_EQ(rig.script("robot").actions[6], WB_TIMEOUT_BRAKE);
}

TEST(DriverHost, AnActivationStartsFromNoCommandAtAll) {
  Rig rig({fake(both())});
  ASSERT_TRUE(rig.host.activate(50'000'000));
  rig.read();
  rig.write();
  ASSERT_TRUE(rig.host.activate(50'000'000));
  EXPECT_EQ(rig.script("robot").deactivations, 1u);
  EXPECT_EQ(rig.script("robot").writes, 1u);  // nothing is written until the controller does
}

TEST(DriverHost, CountersOfThePluginsCarryTheirNames) {
  Rig rig({fake(arm(", counters: [lost_frames, resets]")), fake(wheels())});
  rig.script("arm").counters[1] = 42;
  const auto counters = rig.counters();
  EXPECT_EQ(counters.at("fake.resets"), 42u);
  EXPECT_EQ(counters.at("fake.lost_frames"), 0u);
  EXPECT_EQ(counters.at("fake_2.failed_reads"), 0u);
  EXPECT_EQ(counters.size(), 8u);
}

TEST(DriverHost, FramesWithoutDepthArePassedByAndReleased) {
  RobotConfig robot = mabi()->config();
  robot.cameras.resize(1);
  robot.cameras[0].intrinsics.width = robot.cameras[0].intrinsics.height = 4;
  DriverHost host(robot, {fake(both(", camera: {name: camera_front, width: 4, height: 4}"))}, {});
  auto& script =
      *static_cast<wb_fake_script*>(const_cast<void*>(host.extension("wb.fake/robot", nullptr)));
  script.frames_without_depth = 2;
  script.frames = 1;
  script.depth[15] = 1.5f;
  DepthFrame frame;
  ASSERT_TRUE(host.next_frame(frame));
  EXPECT_EQ(frame.camera, 0);
  ASSERT_EQ(frame.depth.size(), 16u);
  EXPECT_EQ(frame.depth[15], 1.5f);
  EXPECT_EQ(script.released, 3u);
  EXPECT_FALSE(host.next_frame(frame));
}

}  // namespace
}  // namespace wb
