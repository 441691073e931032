// Either side of the protocol is killed; the other one does the safe thing.
#include "tests/drivers/dds/child.hpp"
#include "tests/drivers/dds/dds_fixture.hpp"

namespace wb::dds {
namespace {

using ProcessTest = DdsDriverTest;

std::vector<std::string> process(const char* role, int domain) {
  return {WB_ROBOT_PROCESS, role, std::to_string(domain)};
}

TEST_F(ProcessTest, TheRobotIsKilledAndComesBackAndMovesOnlyAfterANewActivation) {
  auto first = std::make_unique<Child>(process("robot", domain()));
  ASSERT_EQ(first->line(), "ready");
  plugin = std::make_unique<Plugin>(config());
  ASSERT_EQ(plugin->activate(), WB_OK);
  ASSERT_TRUE(write_until(velocity_commands(5, 0.2), [&] {
    return plugin->read() == WB_OK && plugin->readings.joints[0].position > 0.01;
  }));
  first.reset();
  ASSERT_TRUE(wait_until([&] { return plugin->read() == WB_ERROR; }));
  Child second(process("robot", domain()));
  ASSERT_EQ(second.line(), "ready");
  ASSERT_TRUE(wait_until([&] { return plugin->read() == WB_OK; }));
  for (int i = 0; i < 50; ++i) {
    EXPECT_NE(plugin->write(velocity_commands(5, 0.2)), WB_OK);
    sleep_s(0.002);
  }
  ASSERT_EQ(plugin->read(), WB_OK);
  EXPECT_EQ(plugin->readings.joints[0].position, 0);
  EXPECT_EQ(plugin->readings.timed_out, 1u);
  ASSERT_EQ(plugin->deactivate(), WB_OK);
  ASSERT_EQ(plugin->activate(), WB_OK) << plugin->log();
  EXPECT_TRUE(write_until(velocity_commands(5, 0.2), [&] {
    return plugin->read() == WB_OK && plugin->readings.joints[0].position > 0;
  }));
}

TEST_F(ProcessTest, TheCommanderIsKilledAndTheRobotStopsByItselfAndIsFreeAgain) {
  start_low_level();
  {
    Child commander(process("commander", domain()));
    ASSERT_EQ(commander.line(), "ready");
    EXPECT_GT(robot().travel(), 0);
    commander.kill(SIGKILL);
    commander.wait();
  }
  ASSERT_TRUE(wait_until([&] { return robot().stops() > 0; }));
  const double there = robot().travel();
  let_work();
  EXPECT_EQ(robot().travel(), there);
  plugin = std::make_unique<Plugin>(config());
  // The dead one's lease ends with its silence.
  EXPECT_TRUE(wait_until([&] { return plugin->activate() == WB_OK; }));
  EXPECT_TRUE(write_until(velocity_commands(5, 0.2), [&] { return robot().travel() > there; }));
}

TEST_F(ProcessTest, AFrozenCommanderCannotGoOnWhenItThaws) {
  start_low_level();
  Child commander(process("commander", domain()));
  ASSERT_EQ(commander.line(), "ready");
  commander.kill(SIGSTOP);
  ASSERT_TRUE(wait_until([&] { return robot().stops() > 0; }));
  const double there = robot().travel();
  commander.kill(SIGCONT);
  let_work(80);
  EXPECT_EQ(robot().travel(), there);
}

}  // namespace
}  // namespace wb::dds
