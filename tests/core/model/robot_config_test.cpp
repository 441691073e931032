// robot.yaml with one thing wrong at a time: the error names the file, the line, the key and what
// is wrong.
#include "core/model/robot_config.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/config/config.hpp"

namespace wb {
namespace {

const std::filesystem::path kRobot = WB_SOURCE_DIR "/config/robots/mabi_mobile";

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::stringstream out;
  out << in.rdbuf();
  return out.str();
}

struct Fault {
  std::string name;
  std::string before, after;  // the first `before` of robot.yaml becomes `after`
  std::vector<std::string> says;
};

std::ostream& operator<<(std::ostream& out, const Fault& f) { return out << f.name; }

class RobotConfigWith : public ::testing::TestWithParam<Fault> {};

TEST_P(RobotConfigWith, IsRefusedWithFileLineAndKey) {
  const Fault& fault = GetParam();
  std::string text = text_of(kRobot / "robot.yaml");
  const std::size_t at = text.find(fault.before);
  ASSERT_NE(at, std::string::npos) << "robot.yaml no longer holds: " << fault.before;
  text.replace(at, fault.before.size(), fault.after);
  const auto line =
      1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n');

  const std::filesystem::path folder =
      std::filesystem::path(WB_BUILD_DIR) / "tests/core/model" / fault.name;
  std::filesystem::create_directories(folder);
  std::filesystem::copy_file(kRobot / "robot.urdf", folder / "robot.urdf",
                             std::filesystem::copy_options::overwrite_existing);
  std::ofstream(folder / "robot.yaml") << text;
  std::string error;
  try {
    RobotConfig::load(folder);
  } catch (const config::ConfigError& e) {
    error = e.what();
  }
  EXPECT_NE(error.find((folder / "robot.yaml").string() + ":" + std::to_string(line)),
            std::string::npos)
      << "line " << line << ": " << error;
  for (const std::string& word : fault.says) {
    EXPECT_NE(error.find(word), std::string::npos) << word << ": " << error;
  }
}

INSTANTIATE_TEST_SUITE_P(
    AFault, RobotConfigWith,
    ::testing::Values(
        Fault{"UnknownKey",
              "ready_rad:",
              "raedy_rad: [0]\nready_rad:",
              {"unknown key 'raedy_rad'", "did you mean 'ready_rad'"}},
        Fault{"JointThatTheUrdfLacks",
              "name: EL_ROT",
              "name: EL_RTO",
              {"'joints[3].name'", "'EL_RTO'"}},
        Fault{"FixedJoint", "name: EL_ROT", "name: hand_mount", {"'joints[3].name'", "hand_mount"}},
        Fault{"JointTwice",
              "- {name: SH_ROT",
              "- {name: WR_ROT, acceleration_max_radps2: 1}\n  - {name: SH_ROT",
              {"'joints'", "'WR_ROT' twice"}},
        Fault{"DifferentialDriveWithThreeWheels",
              "wheels: [wheel_left, wheel_right]",
              "wheels: [wheel_left, wheel_right, SH_ROT]",
              {"'base.wheels'", "two joints"}},
        Fault{"WrongType",
              "track_m: 0.54",
              "track_m: wide",
              {"'base.track_m'", "must be a number", "'wide'"}},
        Fault{"OutOfRange",
              "wheel_radius_m: 0.1",
              "wheel_radius_m: -0.1",
              {"'base.wheel_radius_m'", "allowed"}},
        Fault{"UnknownBaseKind",
              "kind: differential_drive",
              "kind: diferential_drive",
              {"'base.kind'", "did you mean 'differential_drive'"}},
        Fault{"WheelThatIsNoWheel",
              "wheels: [wheel_left",
              "wheels: [SH_ROT",
              {"'base.wheels'", "'SH_ROT'"}},
        Fault{"BaseThatIsNotTheRoot",
              "link: base\n  wheels",
              "link: hand\n  wheels",
              {"'base.link'", "root"}},
        Fault{"FingerThatTurns",
              "fingers: [finger_left",
              "fingers: [wheel_left",
              {"'fingers'", "'wheel_left'"}},
        Fault{"PostureOutsideLimits",
              "stowed_rad: [-1.92, -1.8",
              "stowed_rad: [-1.92, 1.8",
              {"'stowed_rad'", "SH_FLE", "allowed"}},
        Fault{"PostureOfTooFewJoints",
              "ready_rad: [-1.5708, ",
              "ready_rad: [",
              {"'ready_rad'", "must hold 6"}},
        Fault{"CameraWithoutLink",
              "name: camera_left",
              "name: camera_lost",
              {"'cameras[1].name'", "'camera_lost'"}},
        Fault{"ShoulderCameraThatIsNone",
              "shoulder_camera: camera_shoulder",
              "shoulder_camera: camera_shulder",
              {"'shoulder_camera'", "did you mean 'camera_shoulder'"}},
        Fault{"SphereOnAnUnknownLink",
              "{link: WRIST_1",
              "{link: WRIST_3",
              {"'collision_spheres[", ".link'", "'WRIST_3'"}},
        Fault{"PairOfAnUnknownCapsule",
              "- [arm_hub, tower_left]",
              "- [arm_hbu, tower_left]",
              {"'self_collision_pairs'", "'arm_hbu'"}},
        Fault{"PairOfThree",
              "- [base, SHOULDER]",
              "- [base, SHOULDER, ARM]",
              {"'contact_excluded'", "pairs"}}),
    [](const auto& info) { return info.param.name; });

TEST(RobotConfig, LoadsMabiMobile) {
  const RobotConfig config = RobotConfig::load(kRobot);
  EXPECT_EQ(config.name, "mabi_mobile");
  EXPECT_EQ(config.base.kind, BaseKind::kDifferentialDrive);
  EXPECT_EQ(config.joints.size(), 6u);
  EXPECT_EQ(config.cameras.size(), 5u);
  EXPECT_DOUBLE_EQ(config.cameras[0].intrinsics.fx, 84.3);
  EXPECT_TRUE(std::any_of(config.spheres.begin(), config.spheres.end(),
                          [](const SphereConfig& s) { return s.masked; }));
}

TEST(RobotConfig, MissingFolderNamesTheFile) {
  try {
    RobotConfig::load("/nowhere");
    FAIL();
  } catch (const config::ConfigError& e) {
    EXPECT_NE(std::string(e.what()).find("/nowhere/robot.yaml"), std::string::npos);
  }
}

}  // namespace
}  // namespace wb
