// Every URDF of urdfs/ that must be refused: with its file, the line at fault, and what is wrong.
#include <gtest/gtest.h>
#include <unistd.h>

#include "core/config/config.hpp"
#include "core/model/import/robot_structure.hpp"

namespace wb {
namespace {

const std::filesystem::path kUrdfs = WB_SOURCE_DIR "/tests/core/model/import/urdfs";

struct Refusal {
  const char* file;
  int line;  // 0: any
  const char* says;
};
std::ostream& operator<<(std::ostream& out, const Refusal& r) { return out << r.file; }

class AwkwardUrdf : public ::testing::TestWithParam<Refusal> {};

TEST_P(AwkwardUrdf, IsRefusedWithItsLine) {
  const std::filesystem::path file = kUrdfs / (std::string(GetParam().file) + ".urdf");
  try {
    UrdfDocument document = UrdfDocument::read(file);
    find_structure(document, {});
    FAIL() << "accepted";
  } catch (const config::ConfigError& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find(GetParam().says), std::string::npos) << text;
    const std::string at =
        file.string() + ":" + (GetParam().line ? std::to_string(GetParam().line) + ":" : "");
    EXPECT_TRUE(text.starts_with(at)) << text << "\nmust start with " << at;
  }
}

constexpr Refusal kRefusals[] = {
    {"not_xml", 0, "well-formed"},
    {"xacro", 2, "xacro"},
    {"loop", 21, "A loop cannot be controlled"},
    {"cycle", 5, "belongs to a loop"},
    {"two_roots", 21, "hangs on no joint"},
    {"unknown_child", 23, "is no link of this file"},
    {"twice", 21, "stands twice"},
    {"nan", 16, "no finite number"},
    {"no_limits", 13, "has no <limit>"},
    {"limits_turned", 18, "leave no room"},
    {"negative_velocity", 18, "is negative"},
    {"zero_axis", 17, "axis is zero"},
    {"negative_mass", 2, "must be positive"},
    {"inertia_not_positive", 2, "is not positive"},
    {"inertia_impossible", 2, "no body has the principal moments"},
    {"missing_mesh", 2, "--package DIR"},
    {"unknown_shape", 2, "<cone> is unknown"},
    {"planar_inside", 13, "planar"},
    {"floating_inside", 13, "floating"},
    {"floating_base", 2, "legged"},
    {"mimic_in_the_arm", 13, "mimics"},
    {"mimic_of_nothing", 13, "no joint of this file"},
    {"mimic_of_itself", 13, "itself"},
    {"no_arm", 2, "no arm"},
    {"three_wheels", 6, "two or four are understood"},
};
INSTANTIATE_TEST_SUITE_P(Urdfs, AwkwardUrdf, testing::ValuesIn(kRefusals),
                         [](const auto& info) { return info.param.file; });

TEST(UrdfDocument, OfAFileThatIsNotThereSaysSo) {
  try {
    UrdfDocument::read(kUrdfs / "nowhere.urdf");
    FAIL();
  } catch (const config::ConfigError& error) {
    EXPECT_NE(std::string(error.what()).find("cannot be opened"), std::string::npos);
  }
}

TEST(UrdfDocument, FindsAPackagesMeshUnderTheNamedFolder) {
  // Away from its mesh, which the URDF's own folder would bring.
  const std::filesystem::path alone =
      std::filesystem::path(WB_BUILD_DIR) / ("alone" + std::to_string(getpid()));
  std::filesystem::create_directories(alone);
  std::filesystem::copy_file(kUrdfs / "dummies.urdf", alone / "dummies.urdf");
  EXPECT_THROW(UrdfDocument::read(alone / "dummies.urdf"), config::ConfigError);
  const UrdfDocument document = UrdfDocument::read(alone / "dummies.urdf", {kUrdfs});
  std::filesystem::remove_all(alone);
  const Solid& solid = document.link("base").collisions.at(0).solid;
  EXPECT_EQ(solid.mesh.triangles.size(), 12u);
  // Meshes hold single precision.
  EXPECT_NEAR(solid.volume(), 0.4 * 0.3 * 0.2, 1e-7);
}

TEST(UrdfDocument, IsTheSameAfterBeingWrittenAndReadAgain) {
  const UrdfDocument first =
      UrdfDocument::read(WB_SOURCE_DIR "/config/robots/mabi_mobile/robot.urdf");
  const std::filesystem::path copy =
      std::filesystem::path(WB_BUILD_DIR) / ("copy" + std::to_string(getpid()) + ".urdf");
  first.write(copy, "copy");
  const UrdfDocument second = UrdfDocument::read(copy);
  std::filesystem::remove(copy);
  ASSERT_EQ(second.joints.size(), first.joints.size());
  for (const UrdfJoint& j : first.joints) {
    const UrdfJoint* k = second.joint(j.name);
    ASSERT_NE(k, nullptr);
    EXPECT_EQ(k->type, j.type) << j.name;
    EXPECT_TRUE(k->X_PC.isApprox(j.X_PC, 1e-9)) << j.name;
    EXPECT_TRUE(k->axis.isApprox(j.axis, 1e-9)) << j.name;
    const UrdfLink &a = first.link(j.child), &b = second.link(j.child);
    ASSERT_EQ(a.inertial.has_value(), b.inertial.has_value()) << j.child;
    if (a.inertial) {
      EXPECT_TRUE(b.inertial->inertia.isApprox(a.inertial->inertia, 1e-9)) << j.child;
    }
    ASSERT_EQ(a.collisions.size(), b.collisions.size());
    for (std::size_t i = 0; i < a.collisions.size(); ++i) {
      EXPECT_TRUE(b.collisions[i].solid.X_LS.isApprox(a.collisions[i].solid.X_LS, 1e-9));
      EXPECT_TRUE(b.collisions[i].solid.half.isApprox(a.collisions[i].solid.half, 1e-9));
    }
  }
}

}  // namespace
}  // namespace wb
