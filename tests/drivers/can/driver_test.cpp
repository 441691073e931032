// The driver as a whole on in-process buses: configuration, modes, actions, units, allocation,
// repeatability.
#include <gtest/gtest.h>

#include <cmath>

#include "core/config/config.hpp"
#include "core/rt/allocation_count.hpp"
#include "drivers/can/faults/rig.hpp"

namespace wb::can {
namespace {

// ---- configuration -----------------------------------------------------------------------------

std::string yaml(int drives, const std::string& extra_drive = "", const std::string& extra = "") {
  std::string text =
      "sync_rate_hz: 400\n" + extra +
      "buses:\n  - {name: arm, type: unix, path: arm.sock, bit_rate: 1000000, paced: true}\n"
      "drives:\n";
  for (int i = 1; i <= drives; ++i) {
    text += "  - {joint: j" + std::to_string(i) + ", bus: arm, node: " + std::to_string(i) +
            ", mode: csp, counts_per_rad: 100000, torque_per_permille_nm: 0.1, "
            "velocity_max_radps: 2, effort_max_nm: 20" +
            extra_drive + "}\n";
  }
  return text;
}

std::string error_of(const std::string& text) {
  try {
    (void)PluginConfig::parse(text, "/tmp");
  } catch (const config::ConfigError& error) {
    return error.what();
  }
  return "";
}

TEST(CanConfig, FourDrivesFitOnABusAt400HzAndFiveAreRefusedWithTheNumbers) {
  const PluginConfig config = PluginConfig::parse(yaml(4), "/tmp");
  // (4 (125 + 135 + 125) + 55) bits at 400 Hz, and 5 heartbeats of 65 bits at 10 Hz.
  EXPECT_NEAR(config.buses[0].load, (1595.0 * 400 + 50 * 65) / 1e6, 1e-9);
  const std::string error = error_of(yaml(5));
  EXPECT_NE(error.find("5 drives"), std::string::npos) << error;
  EXPECT_NE(error.find("80 %"), std::string::npos) << error;
  EXPECT_NE(error.find("at most 4 drives"), std::string::npos) << error;
  EXPECT_EQ(error_of(yaml(6, "", "supervision: {velocity_every: 8}\n")), "");
}

TEST(CanConfig, NamesWhatIsWrong) {
  EXPECT_NE(error_of(yaml(1, ", sign: 2")).find("sign"), std::string::npos);
  EXPECT_NE(error_of(yaml(1, ", following_max_radps: 1")).find("following_max_radps"),
            std::string::npos);
  EXPECT_NE(error_of(yaml(1, "", "rate_hz: 1\n")).find("rate_hz"), std::string::npos);
  EXPECT_NE(error_of(yaml(1, "", "supervision: {heartbeat_ms: 100, heartbeat_lost_ms: 150}\n"))
                .find("twice"),
            std::string::npos);
  std::string twice = yaml(2);
  twice.replace(twice.find("node: 2"), 7, "node: 1");
  EXPECT_NE(error_of(twice).find("two drives"), std::string::npos) << error_of(twice);
}

// ---- life cycle --------------------------------------------------------------------------------

TEST(CanDriver, NothingMovesBeforeTheFirstWriteAndNoneWithoutActivate) {
  Rig rig;
  rig.commanding = false;
  ASSERT_EQ(rig.driver->configure(), WB_OK);
  const auto before = rig.positions();
  EXPECT_EQ(rig.driver->write(rig.commands), WB_BAD_STATE);
  rig.run(0.3);
  EXPECT_FALSE(rig.any_enabled());
  ASSERT_EQ(rig.activate(), WB_OK);
  rig.run(0.045);  // within the command's time-out
  EXPECT_TRUE(rig.any_enabled());
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_NEAR(rig.positions()[i], before[i], 1e-9);
}

TEST(CanDriver, EveryModeFollowsItsTargets) {
  for (const DriveMode mode : {DriveMode::kCsp, DriveMode::kCsv, DriveMode::kCst}) {
    RigOptions options;
    options.mode = mode;
    Rig rig(options);
    ASSERT_TRUE(rig.start()) << rig.log();
    wb_description description;
    rig.driver->describe(description);
    EXPECT_EQ(description.joints[0].command_kinds, 1u << rig.commands.joints[0].kind);
    double worst = 0;
    rig.run(3, [&] {
      const auto& c = rig.commands.joints[0];
      const auto& r = rig.readings.joints[0];
      worst = std::max(worst, mode == DriveMode::kCsp   ? std::abs(c.position - r.position)
                              : mode == DriveMode::kCsv ? std::abs(c.velocity - r.velocity)
                                                        : std::abs(c.effort - r.effort));
      return true;
    });
    EXPECT_TRUE(rig.all_follow());
    // Three periods late at most, at up to 0.8 rad/s (csv: 0.8 rad/s^2; cst: steps of 0.1 Nm).
    EXPECT_LT(worst, mode == DriveMode::kCst ? 0.11 : 3 * 0.0025 * 0.8 + 1e-3)
        << static_cast<int>(mode);
    EXPECT_GT(rig.readings.joints[0].quality, 0.99);
  }
}

TEST(CanDriver, UnitsSignAndOffsetAreTheJoints) {
  RigOptions options;
  options.adjust = [](int joint, DriveConfig& d, NodeOptions& n) {
    d.scale.counts_per_unit = 5e4 * (joint + 1);
    d.scale.sign = joint % 2 ? -1 : 1;
    d.scale.offset = 0.3 * joint;
    n.scale = d.scale;
  };
  Rig rig(options);
  ASSERT_TRUE(rig.start()) << rig.log();
  rig.run(1);
  for (int i = 0; i < rig.joints(); ++i) {
    const double truth = rig.models[static_cast<std::size_t>(i)]->position();
    EXPECT_NEAR(rig.readings.joints[i].position, truth, 0.0025 * 0.8 + 3e-5) << i;
    EXPECT_NEAR(truth, rig.commands.joints[i].position, 3 * 0.0025 * 0.8) << i;
  }
}

TEST(CanDriver, WheelThatRunsOverTheEndOfItsCounterGoesOn) {
  RigOptions options;
  options.drives = 1;
  options.mode = DriveMode::kCsv;
  options.adjust = [](int, DriveConfig& d, NodeOptions& n) {
    d.position_min = d.position_max = 0;
    d.following_max = 0;
    d.scale.counts_per_unit = n.scale.counts_per_unit = 1e9;  // 2^32 counts: 4.3 rad
  };
  Rig rig(options);
  rig.spoil = [](wb_commands& c) { c.joints[0].velocity = 1.5; };
  ASSERT_TRUE(rig.start()) << rig.log();
  const double start = rig.readings.joints[0].position, truth = rig.models[0]->position();
  rig.run(4);
  EXPECT_TRUE(rig.all_follow()) << rig.log();
  EXPECT_NEAR(rig.readings.joints[0].position - start, rig.models[0]->position() - truth, 0.01);
  EXPECT_GT(rig.models[0]->position() - truth, 5.5) << "more than one turn of the counter";
}

// ---- stopping ----------------------------------------------------------------------------------

TEST(CanDriver, TimeOutActionIsWhatTheDriveDoes) {
  const struct {
    wb_timeout_action action;
    std::uint64_t option;
    DriveState end;
  } cases[] = {{WB_TIMEOUT_HOLD, 6, DriveState::kQuickStopActive},
               {WB_TIMEOUT_BRAKE, 2, DriveState::kSwitchOnDisabled},
               {WB_TIMEOUT_DAMPED, 1, DriveState::kSwitchOnDisabled}};
  for (const auto& c : cases) {
    Rig rig;
    ASSERT_EQ(rig.driver->configure(), WB_OK);
    rig.run(0.05);
    const std::vector<wb_timeout_action> actions(4, c.action);
    ASSERT_EQ(rig.driver->activate(50'000'000, actions.data()), WB_OK);
    rig.run(0.6);
    ASSERT_TRUE(rig.all_follow());
    EXPECT_EQ(rig.nodes[0]->object(0x605A, 0), c.option);
    rig.commanding = false;
    rig.run(0.5);
    EXPECT_EQ(state_of(rig.nodes[0]->statusword()), c.end);
    EXPECT_EQ(rig.readings.timed_out, 1u);
    EXPECT_EQ(rig.readings.joints[0].status, static_cast<std::uint32_t>(WB_JOINT_STOPPED));
  }
}

TEST(CanDriver, StopInTheSameTickKeepsTheWrittenCommandFromTheWire) {
  Rig rig;
  ASSERT_TRUE(rig.start());
  const std::uint64_t enabling = rig.sniffers[0]->enabling;
  ASSERT_EQ(rig.written, WB_OK);  // written in this tick, not yet sent
  ASSERT_EQ(rig.driver->stop(), WB_OK);
  rig.run(0.5);
  EXPECT_EQ(rig.sniffers[0]->enabling, enabling);
  EXPECT_EQ(rig.written, WB_TIMED_OUT);
}

TEST(CanDriver, JointWithoutACommandStopsAloneAndComesBackWithOne) {
  Rig rig;
  ASSERT_TRUE(rig.start());
  rig.spoil = [](wb_commands& c) { c.joints[2].kind = WB_CMD_NONE; };
  rig.run(0.2);
  EXPECT_FALSE(rig.nodes[2]->enabled());
  EXPECT_TRUE(rig.nodes[1]->enabled());
  EXPECT_EQ(rig.readings.joints[2].status, static_cast<std::uint32_t>(WB_JOINT_STOPPED));
  EXPECT_EQ(rig.readings.timed_out, 0u);
}

TEST(CanDriver, RefusedCommandsDoNotFeedTheWatch) {
  Rig rig;
  ASSERT_TRUE(rig.start());
  rig.spoil = [](wb_commands& c) { c.joints[0].position = std::nan(""); };
  rig.run(0.1);
  EXPECT_EQ(rig.driver->stop_event(), static_cast<int>(Event::kCommandTimeout));
}

TEST(CanDriver, OtherKindOfCommandIsRefused) {
  Rig rig;
  ASSERT_TRUE(rig.start());
  rig.spoil = [](wb_commands& c) { c.joints[0].kind = WB_CMD_TORQUE; };
  rig.run(0.0025);
  EXPECT_EQ(rig.written, WB_ERROR);
}

TEST(CanDriver, DrivesAreWithoutPowerAfterDeactivateAndAfterTheDriverIsGone) {
  Rig rig;
  ASSERT_TRUE(rig.start());
  ASSERT_EQ(rig.driver->deactivate(), WB_OK);
  rig.run(0.5);
  EXPECT_EQ(state_of(rig.nodes[0]->statusword()), DriveState::kSwitchOnDisabled);
  ASSERT_EQ(rig.activate(), WB_OK);
  rig.run(0.3);
  ASSERT_TRUE(rig.all_follow());
  rig.driver.reset();
  EXPECT_FALSE(rig.any_enabled());
}

TEST(CanDriver, EmergencyFloodIsCountedButHardlyLogged) {
  Rig rig;
  ASSERT_TRUE(rig.start());
  Frame emcy;
  emcy.id = 0x81;
  emcy.length = 8;
  emcy.data = {0x10, 0x43, 1};
  rig.babble(emcy, 1, 2000);
  rig.run(2);
  EXPECT_GT(rig.driver->count(Event::kEmergency), 1000u);
  std::size_t lines = 0;
  for (std::size_t at = 0; (at = rig.log().find("emergency", at)) != std::string::npos; ++at)
    ++lines;
  EXPECT_LE(lines, 3u);
}

// ---- the step itself ---------------------------------------------------------------------------

TEST(CanDriver, InterfaceThatWasDownFirstIsToldAsGone) {
  Rig rig;
  ASSERT_TRUE(rig.start()) << rig.log();
  InProcessBus& bus = *rig.buses[0];
  bus.set_link(*rig.bus_ports[0], LinkState::kDown);
  rig.run(0.1);
  EXPECT_EQ(rig.driver->count(Event::kLinkDown), 1u);
  EXPECT_EQ(rig.driver->count(Event::kLinkGone), 0u);
  bus.set_link(*rig.bus_ports[0], LinkState::kGone);
  rig.run(0.1);
  EXPECT_EQ(rig.driver->count(Event::kLinkGone), 1u);
  EXPECT_NE(rig.log().find("has gone"), std::string::npos) << rig.log();
  EXPECT_EQ(rig.driver->count(Event::kLinkBack), 0u);
}

TEST(CanDriver, PortsAllocateNothing) {
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns malloc";
  Rig rig;
  ASSERT_TRUE(rig.start());
  wb_commands commands = rig.commands;
  const std::uint64_t before = thread_allocations();
  for (int k = 1; k <= 400; ++k) {
    const TimeNs t = rig.now() + k * Rig::kPeriod;
    (void)rig.driver->advance(t);
    (void)rig.driver->read(rig.readings);
    commands.t_ns = t;
    if (k == 200) rig.nodes[0]->send_emergency(0x2310);
    if (k == 300) (void)rig.driver->stop();
    (void)rig.driver->write(commands);
  }
  EXPECT_EQ(thread_allocations(), before);
}

TEST(CanDriver, SameRunTwiceIsTheSameBitForBit) {
  const auto run = [] {
    Rig rig;
    FaultRule rule;
    rule.share = 0.02;
    rule.id = 0x180;
    rule.mask = 0x780;
    rig.buses[0]->faults().add(rule);
    std::vector<double> values;
    if (!rig.start()) return values;
    rig.run(2, [&] {
      for (int i = 0; i < rig.joints(); ++i) values.push_back(rig.readings.joints[i].position);
      return true;
    });
    values.push_back(static_cast<double>(rig.driver->count(Event::kTpdoMissed)));
    return values;
  };
  const auto first = run();
  ASSERT_GT(first.size(), 1000u);
  EXPECT_GT(first.back(), 20) << "frames were lost";
  EXPECT_EQ(first, run());
}

}  // namespace
}  // namespace wb::can
