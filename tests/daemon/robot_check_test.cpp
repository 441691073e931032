// `wbctl robot check`: robots that are known to run pass every line, the simulator's included; what
// cannot be simulated or controlled is a failed line that says why.
#include "daemon/robot/robot_check.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>

#include "core/model/import/urdf_import.hpp"
#include "daemon/robot/simulated_move.hpp"

namespace wb {
namespace {

namespace fs = std::filesystem;
const fs::path kRobots = WB_SOURCE_DIR "/config/robots";

void expect_all_ok(const fs::path& folder) {
  const std::vector<CheckLine> lines = check_robot(folder, {.samples = 5});
  EXPECT_TRUE(std::any_of(lines.begin(), lines.end(),
                          [](const CheckLine& l) { return l.name == "simulation"; }));
  for (const CheckLine& l : lines) EXPECT_TRUE(l.ok) << l.name << " " << l.value << ": " << l.text;
}

class RobotCheck : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(WB_BUILD_DIR) / ("robot_check_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  void copy(const std::string& robot) {
    fs::copy(kRobots / robot, folder_, fs::copy_options::recursive);
  }
  fs::path folder_;
};

class EveryRobotCheck : public RobotCheck, public ::testing::WithParamInterface<const char*> {};

TEST_P(EveryRobotCheck, HasNoFailedLine) { expect_all_ok(kRobots / GetParam()); }

TEST_P(EveryRobotCheck, HasNoFailedLineWhenItsFolderIsMadeOfItsUrdfAlone) {
  ImportOptions options;
  options.name = "imported";
  options.sampling.seed = 4711;  // not looked at
  import_urdf(kRobots / GetParam() / "robot.urdf", folder_, options);
  expect_all_ok(folder_);
}

INSTANTIATE_TEST_SUITE_P(Robots, EveryRobotCheck,
                         ::testing::Values("mabi_mobile", "panda", "ridgeback_ur5", "torso_lift"));

TEST_F(RobotCheck, WithoutSimYamlTheSimulationFailsAndNamesTheFile) {
  copy("panda");
  fs::remove(folder_ / "sim.yaml");
  const CheckLine line = check_simulated_move(folder_, 1);
  EXPECT_FALSE(line.ok);
  EXPECT_NE(line.text.find("sim.yaml"), std::string::npos) << line.text;
}

TEST_F(RobotCheck, AnUnknownKeyOfControlYamlFailsTheSimulation) {
  copy("panda");
  std::ofstream(folder_ / "control.yaml", std::ios::app) << "surprise: 1\n";
  const CheckLine line = check_simulated_move(folder_, 1);
  EXPECT_FALSE(line.ok);
  EXPECT_NE(line.text.find("surprise"), std::string::npos) << line.text;
}

}  // namespace
}  // namespace wb
