// What wholebodyd.yaml may say of its drivers.
#include "daemon/daemon_config.hpp"

#include <gtest/gtest.h>

namespace wb {
namespace {

// The daemon's own configuration with a line added to its driver.
DaemonConfig with_driver_line(const std::string& line) {
  const std::string loop = "{rate_hz: 10}";
  return DaemonConfig::from(
      config::Section::parse("robot: robots/mabi_mobile\ninterpreter: none\nseed: 1\n"
                             "command_timeout_ms: 50\nloops: {control: " +
                                 loop + ", mpc: " + loop + ", frames: " + loop +
                                 ", mapping: " + loop + ", perception: " + loop +
                                 "}\ndrivers:\n  - plugin: libwb_driver_can.so\n    " + line +
                                 "\n    config: {bus: can0}\n",
                             "test"),
      "/etc", "/usr/lib/wholebody");
}

TEST(DaemonConfig, ADriverIsCommandedByWhatItsJointsSupportUnlessItSaysOtherwise) {
  EXPECT_EQ(with_driver_line("").drivers.at(0).command, WB_CMD_NONE);
  EXPECT_EQ(with_driver_line("command: impedance").drivers.at(0).command, WB_CMD_IMPEDANCE);
  EXPECT_EQ(with_driver_line("command: position").drivers.at(0).command, WB_CMD_POSITION);
  EXPECT_EQ(with_driver_line("command: torque").drivers.at(0).command, WB_CMD_TORQUE);
}

TEST(DaemonConfig, AnUnknownKindOfCommandIsRefusedNamingThoseThatAreAllowed) {
  try {
    with_driver_line("command: torqe");
    FAIL() << "accepted";
  } catch (const config::ConfigError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("torqe"), std::string::npos) << text;
    EXPECT_NE(text.find("impedance"), std::string::npos) << text;
  }
}

}  // namespace
}  // namespace wb
