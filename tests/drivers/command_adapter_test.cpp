// How a joint's commands are adapted to what its driver supports.
#include "drivers/command_adapter.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "core/config/config.hpp"

namespace wb {
namespace {

constexpr std::uint32_t bit(wb_command_kind kind) { return 1u << kind; }

wb_joint_info joint(std::uint32_t kinds, double effort_max = 100.0) {
  wb_joint_info info{"elbow", -3, 3, 1, effort_max, kinds, 0};
  return info;
}

std::string message_of(const wb_joint_info& info, bool wheel, wb_command_kind wanted) {
  try {
    CommandAdapter(info, wheel, wanted);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

const JointCommand kCommand{CommandKind::kImpedance, 0.5, 0.25, 3.0, 40.0, 8.0};

JointReading reading(double position, double velocity) {
  JointReading r;
  r.position = position;
  r.velocity = velocity;
  r.valid = true;
  return r;
}

TEST(CommandAdapter, PrefersImpedanceThenPositionThenTorque) {
  const std::uint32_t i = bit(WB_CMD_IMPEDANCE), p = bit(WB_CMD_POSITION), t = bit(WB_CMD_TORQUE),
                      v = bit(WB_CMD_VELOCITY);
  EXPECT_EQ(CommandAdapter(joint(i | p | t | v), false, WB_CMD_NONE).kind(), WB_CMD_IMPEDANCE);
  EXPECT_EQ(CommandAdapter(joint(p | t | v), false, WB_CMD_NONE).kind(), WB_CMD_POSITION);
  EXPECT_EQ(CommandAdapter(joint(t | v), false, WB_CMD_NONE).kind(), WB_CMD_TORQUE);
}

TEST(CommandAdapter, RefusesAJointThatOnlyTakesVelocityNamingJointAndKinds) {
  EXPECT_EQ(message_of(joint(bit(WB_CMD_VELOCITY)), false, WB_CMD_NONE),
            "joint elbow supports velocity, the controller needs impedance, position or torque");
}

TEST(CommandAdapter, RefusesAWheelThatTakesNoVelocityNamingItsKinds) {
  EXPECT_EQ(message_of(joint(bit(WB_CMD_TORQUE)), true, WB_CMD_NONE),
            "joint elbow supports torque, a wheel needs velocity");
}

TEST(CommandAdapter, RefusesAForcedKindThatIsNotSupportedAsAConfigurationError) {
  EXPECT_THROW(CommandAdapter(joint(bit(WB_CMD_POSITION)), false, WB_CMD_TORQUE),
               config::ConfigError);
  EXPECT_EQ(message_of(joint(bit(WB_CMD_POSITION)), false, WB_CMD_TORQUE),
            "joint elbow supports position, its driver's 'command' asks for torque");
}

TEST(CommandAdapter, AForcedKindTakesTheBetterOnesPlace) {
  const wb_joint_info both = joint(bit(WB_CMD_IMPEDANCE) | bit(WB_CMD_TORQUE));
  EXPECT_EQ(CommandAdapter(both, false, WB_CMD_TORQUE).kind(), WB_CMD_TORQUE);
}

TEST(CommandAdapter, PassesImpedanceOnAsItIs) {
  wb_commands out{};
  CommandAdapter(joint(bit(WB_CMD_IMPEDANCE)), false, WB_CMD_NONE)
      .adapt(kCommand, reading(0, 0), out, 2);
  EXPECT_EQ(out.joints[2].kind, WB_CMD_IMPEDANCE);
  EXPECT_EQ(out.joints[2].position, 0.5);
  EXPECT_EQ(out.joints[2].velocity, 0.25);
  EXPECT_EQ(out.joints[2].effort, 3.0);
  EXPECT_EQ(out.joints[2].stiffness, 40.0);
  EXPECT_EQ(out.joints[2].damping, 8.0);
}

TEST(CommandAdapter, PositionCarriesVelocityAndEffortAsFeedForward) {
  wb_commands out{};
  CommandAdapter(joint(bit(WB_CMD_POSITION)), false, WB_CMD_NONE)
      .adapt(kCommand, reading(0, 0), out, 0);
  EXPECT_EQ(out.joints[0].kind, WB_CMD_POSITION);
  EXPECT_EQ(out.joints[0].position, 0.5);
  EXPECT_EQ(out.joints[0].velocity, 0.25);
  EXPECT_EQ(out.joints[0].effort, 3.0);
}

TEST(CommandAdapter, TorqueIsWhatTheImpedanceComesToAtTheNewestReading) {
  wb_commands out{};
  CommandAdapter(joint(bit(WB_CMD_TORQUE)), false, WB_CMD_NONE)
      .adapt(kCommand, reading(0.375, -0.5), out, 0);
  EXPECT_EQ(out.joints[0].kind, WB_CMD_TORQUE);
  EXPECT_EQ(out.joints[0].effort, 14.0);  // 40 * 0.125 + 8 * 0.75 + 3
}

TEST(CommandAdapter, TorqueIsClippedToTheJointsLimitOnBothSides) {
  const CommandAdapter torque(joint(bit(WB_CMD_TORQUE), 10.0), false, WB_CMD_NONE);
  wb_commands out{};
  torque.adapt(kCommand, reading(-2.0, 0), out, 0);
  EXPECT_EQ(out.joints[0].effort, 10.0);
  torque.adapt(kCommand, reading(2.0, 0), out, 0);
  EXPECT_EQ(out.joints[0].effort, -10.0);
}

TEST(CommandAdapter, TorqueIsRefusedWithoutAValidReading) {
  const CommandAdapter torque(joint(bit(WB_CMD_TORQUE)), false, WB_CMD_NONE);
  wb_commands out{};
  JointReading bad = reading(0, 0);
  bad.valid = false;
  torque.adapt(kCommand, reading(0, 0), out, 0);
  ASSERT_EQ(out.joints[0].kind, WB_CMD_TORQUE);
  torque.adapt(kCommand, bad, out, 0);
  EXPECT_EQ(out.joints[0].kind, WB_CMD_NONE);
  EXPECT_EQ(out.joints[0].effort, 0.0);
  torque.adapt(kCommand, reading(std::numeric_limits<double>::quiet_NaN(), 0), out, 0);
  EXPECT_EQ(out.joints[0].kind, WB_CMD_NONE);
}

TEST(CommandAdapter, NoCommandStaysNoneWhateverTheKind) {
  for (const wb_command_kind kind : {WB_CMD_IMPEDANCE, WB_CMD_POSITION, WB_CMD_TORQUE}) {
    wb_commands out{};
    out.joints[0].kind = kind;
    CommandAdapter(joint(bit(kind)), false, WB_CMD_NONE)
        .adapt(JointCommand{}, reading(0, 0), out, 0);
    EXPECT_EQ(out.joints[0].kind, WB_CMD_NONE) << to_string(kind);
  }
}

TEST(CommandAdapter, AWheelIsCommandedByVelocity) {
  wb_commands out{};
  JointCommand roll;
  roll.kind = CommandKind::kVelocity;
  roll.velocity = 2.0;
  CommandAdapter(joint(bit(WB_CMD_VELOCITY)), true, WB_CMD_NONE).adapt(roll, reading(0, 0), out, 1);
  EXPECT_EQ(out.joints[1].kind, WB_CMD_VELOCITY);
  EXPECT_EQ(out.joints[1].velocity, 2.0);
}

}  // namespace
}  // namespace wb
