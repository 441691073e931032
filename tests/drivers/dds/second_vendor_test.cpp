// The plugin and the daemon against another DDS vendor's implementation (Fast DDS).
#include <sys/wait.h>

#include <cstdio>
#include <fstream>

#include "tests/drivers/dds/child.hpp"
#include "tests/drivers/dds/dds_fixture.hpp"

namespace wb::dds {
namespace {

constexpr int kLifeS = 90;  // of the peer, unless it is ended before

// No tag: Fast DDS has none. Domains that the project's other tests do not use.
class SecondVendor : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    setenv("CYCLONEDDS_URI", "file://" WB_SOURCE_DIR "/config/cyclonedds_loopback.xml", 1);
  }
  static int domain() { return 202 + getpid() % 30; }

  // The value of a key in the peer's last line.
  static std::string value(const std::string& output, const std::string& key) {
    const std::size_t at = output.find("\"" + key + "\": ");
    if (at == std::string::npos) return "";
    const std::size_t from = at + key.size() + 4;
    return output.substr(from, output.find_first_of(",}", from) - from);
  }
};

TEST_F(SecondVendor, DrivesItsJointsByThePlugin) {
  Child peer({WB_FASTDDS_PEER, std::to_string(domain()), std::to_string(kLifeS)});
  Plugin plugin("{domain: " + std::to_string(domain()) +
                ", prefix: robot, clock: ros, joints: all, sample_memory_ms: 400, silence_ms: "
                "1000, connect_timeout_ms: 60000}");
  ASSERT_EQ(plugin.description.joint_count, 2u);
  EXPECT_STREQ(plugin.description.joints[1].name, "joint_1");
  ASSERT_EQ(plugin.activate(2 * kNanosPerSecond), WB_OK) << plugin.log();
  wb_commands c = velocity_commands(2, 0);
  c.joints[1].velocity = 0.5;
  ASSERT_TRUE(wait_until([&] {
    plugin.write(c);
    sleep_s(0.005);
    return plugin.read() == WB_OK && plugin.readings.joints[1].position > 0.1;
  }));
  EXPECT_EQ(plugin.readings.joints[0].position, 0);
  EXPECT_EQ(plugin.readings.joints[1].status, WB_JOINT_FOLLOWING);
  ASSERT_TRUE(wait_until([&] {
    return plugin.read() == WB_OK && plugin.readings.joints[1].status == WB_JOINT_STOPPED;
  })) << "writes have ceased";
  peer.kill(SIGTERM);
  const std::string said = peer.wait();
  EXPECT_EQ(value(said, "granted"), "1") << said;
  EXPECT_EQ(value(said, "stops"), "1") << said;
  EXPECT_GT(std::atoi(value(said, "applied").c_str()), 0) << said;
}

TEST_F(SecondVendor, SeesTheDaemonsTopics) {
  setenv("ROS_DOMAIN_ID", std::to_string(domain()).c_str(), 1);
  Child daemon({WB_WHOLEBODYD, "--config", WB_SOURCE_DIR "/config/wholebodyd.yaml", "--lockstep"});
  Child peer({WB_FASTDDS_PEER, std::to_string(domain()), std::to_string(kLifeS)});
  // The virtual clock waits for the first request; wbctl gives up sooner than a loaded machine
  // starts the daemon.
  ASSERT_TRUE(wait_until(
      [] {
        Child reset({WB_WBCTL, "reset"});
        reset.wait();
        return reset.succeeded();
      },
      kLifeS));
  EXPECT_EQ(peer.line(), "both seen");
  peer.kill(SIGTERM);
  const std::string said = peer.wait();
  daemon.kill(SIGTERM);
  daemon.wait();
  EXPECT_GT(std::atoi(value(said, "status").c_str()), 0) << said;
  EXPECT_EQ(value(said, "mode"), "\"ready\"") << said;
  EXPECT_GT(std::atoi(value(said, "joint_states").c_str()), 0) << said;
  EXPECT_NE(value(said, "first_joint"), "\"\"") << said;
}

}  // namespace
}  // namespace wb::dds
