// What find_structure makes of URDFs with gaps, dummy joints and meshes, and of Mabi-Mobile's own.
#include "core/model/import/robot_structure.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace wb {
namespace {

const std::filesystem::path kUrdfs = WB_SOURCE_DIR "/tests/core/model/import/urdfs";

bool says(const RobotStructure& s, const std::string& text) {
  return std::any_of(s.notes.begin(), s.notes.end(),
                     [&](const std::string& note) { return note.find(text) != std::string::npos; });
}

TEST(RobotStructure, OfMabiMobileIsWhatItsRobotYamlSays) {
  UrdfDocument document = UrdfDocument::read(WB_SOURCE_DIR "/config/robots/mabi_mobile/robot.urdf");
  const RobotStructure s = find_structure(document, {});
  const RobotConfig robot = RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile");
  EXPECT_EQ(s.base, ImportedBase::kDifferentialDrive);
  EXPECT_EQ(document.root, robot.base.link);
  ASSERT_EQ(s.wheels.size(), 2u);
  EXPECT_EQ(s.wheels[0], robot.base.wheels[0]);
  EXPECT_EQ(s.wheels[1], robot.base.wheels[1]);
  EXPECT_NEAR(s.wheel_radius_m, robot.base.wheel_radius_m, 1e-9);
  EXPECT_NEAR(s.track_m, robot.base.track_m, 1e-9);
  ASSERT_EQ(s.joints.size(), robot.joints.size());
  for (std::size_t i = 0; i < s.joints.size(); ++i) EXPECT_EQ(s.joints[i], robot.joints[i].name);
  EXPECT_EQ(s.end_effector, robot.end_effector);
  EXPECT_EQ(s.fingers, robot.fingers);
  EXPECT_NEAR(s.gripper_opening_m, robot.gripper_opening_max_m, 1e-12);
  EXPECT_EQ(s.wrench_link, "hand");
  EXPECT_EQ(s.imu, "imu_link");
  EXPECT_EQ(s.cameras.size(), robot.cameras.size());
  EXPECT_EQ(s.castors, (std::vector<std::string>{"castor_0", "castor_1", "castor_2", "castor_3"}));
}

TEST(RobotStructure, GapsAreFilledAndSaid) {
  UrdfDocument document = UrdfDocument::read(kUrdfs / "gaps.urdf");
  const RobotStructure s = find_structure(document, {});
  EXPECT_EQ(s.base, ImportedBase::kFixed);
  EXPECT_EQ(s.joints, (std::vector<std::string>{"turn", "elbow", "wrist"}));
  EXPECT_TRUE(says(s, "inertia of link upper"));
  EXPECT_NEAR(document.link("upper").inertial->mass, 1000 * 0.1 * 0.1 * 0.4, 1e-9);
  EXPECT_TRUE(says(s, "limits of joint turn"));
  EXPECT_TRUE(says(s, "limits of joint elbow"));
  // Twice the weight beyond, at the length of the chain: an upper bound, so that it can hold it.
  EXPECT_GE(*document.joint("elbow")->limit->effort, 2 * 1 * 9.81 * 0.4);
}

TEST(RobotStructure, EndEffectorLiesBetweenThePadsWithYAlongTheStroke) {
  UrdfDocument document = UrdfDocument::read(kUrdfs / "gaps.urdf");
  const RobotStructure s = find_structure(document, {});
  EXPECT_EQ(s.fingers, (std::vector<std::string>{"left", "right"}));
  EXPECT_NEAR(s.gripper_opening_m, 0.08, 1e-12);
  EXPECT_EQ(s.end_effector, "end_effector");
  const auto poses = document.poses();
  const Eigen::Isometry3d X = poses.at("tip").inverse() * poses.at("end_effector");
  // Tips of the fingers at 0.05 + 0.02, a pad's half length back.
  EXPECT_TRUE(X.translation().isApprox(Eigen::Vector3d(0, 0, 0.06), 1e-6)) << X.translation();
  EXPECT_NEAR(std::abs(X.linear()(1, 1)), 1, 1e-9);
  EXPECT_NEAR(X.linear()(2, 2), 1, 1e-9);
}

TEST(RobotStructure, DummyJointsMakeAnOmnidirectionalBaseWithInventedWheels) {
  UrdfDocument document = UrdfDocument::read(kUrdfs / "dummies.urdf", {kUrdfs});
  const RobotStructure s = find_structure(document, {});
  EXPECT_EQ(s.base, ImportedBase::kOmnidirectional);
  EXPECT_EQ(s.wheels, (std::vector<std::string>{"wheel_front_left", "wheel_front_right",
                                                "wheel_rear_left", "wheel_rear_right"}));
  EXPECT_EQ(s.joints, (std::vector<std::string>{"shoulder", "elbow"}));
  EXPECT_EQ(document.joint("x"), nullptr);
  EXPECT_TRUE(says(s, "invented"));
  // B is on the floor: the wheels' axles one radius above it.
  const auto poses = document.poses();
  EXPECT_NEAR(poses.at("wheel_front_left_link").translation().z(), s.wheel_radius_m, 1e-9);
}

TEST(RobotStructure, BaseAndEndEffectorCanBeAskedFor) {
  StructureOptions options;
  options.base = ImportedBase::kFixed;
  options.end_effector = "WRIST_2";
  UrdfDocument document = UrdfDocument::read(WB_SOURCE_DIR "/config/robots/mabi_mobile/robot.urdf");
  const RobotStructure s = find_structure(document, options);
  EXPECT_EQ(s.base, ImportedBase::kFixed);
  EXPECT_TRUE(s.wheels.empty());
  EXPECT_EQ(document.joint("wheel_left")->type, UrdfJoint::Type::kFixed);
  EXPECT_EQ(s.end_effector, "WRIST_2");
}

}  // namespace
}  // namespace wb
