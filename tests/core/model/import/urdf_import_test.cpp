// Whole imports: the folder that is written loads strictly and is the robot that was imported.
#include "core/model/import/urdf_import.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <fstream>

#include "core/config/config.hpp"

namespace wb {
namespace {

namespace fs = std::filesystem;
const fs::path kUrdfs = WB_SOURCE_DIR "/tests/core/model/import/urdfs";

class UrdfImport : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(WB_BUILD_DIR) / ("import_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  static ImportOptions options(const std::string& name) {
    ImportOptions o;
    o.name = name;
    o.packages = {kUrdfs};
    o.sampling.samples = 3000;
    return o;
  }
  static std::string text(const fs::path& file) {
    std::ifstream in(file);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  fs::path folder_;
};

TEST_F(UrdfImport, OfMabiMobileIsMabiMobileAgain) {
  const fs::path original = WB_SOURCE_DIR "/config/robots/mabi_mobile";
  const ImportReport report = import_urdf(original / "robot.urdf", folder_, options("copy"));
  const RobotConfig a = RobotConfig::load(original), b = RobotConfig::load(folder_);
  EXPECT_EQ(b.name, "copy");
  EXPECT_EQ(b.base.kind, a.base.kind);
  EXPECT_NEAR(b.base.track_m, a.base.track_m, 1e-9);
  EXPECT_NEAR(b.base.bounding_radius_m, a.base.bounding_radius_m, 0.05);
  EXPECT_EQ(b.end_effector, a.end_effector);
  EXPECT_EQ(b.fingers, a.fingers);
  const RobotModel old(a), fresh(b);
  ASSERT_EQ(fresh.joints(), old.joints());
  EXPECT_NEAR(fresh.mass(), old.mass(), 1e-6);
  for (int j = 0; j < old.joints(); ++j) {
    EXPECT_EQ(b.joints[j].name, a.joints[j].name);
    EXPECT_NEAR(fresh.limits(j).lower, old.limits(j).lower, 1e-9);
    EXPECT_NEAR(fresh.limits(j).upper, old.limits(j).upper, 1e-9);
    EXPECT_NEAR(fresh.limits(j).velocity, old.limits(j).velocity, 1e-9);
    EXPECT_NEAR(fresh.limits(j).torque, old.limits(j).torque, 1e-9);
    // The guess is within a factor of four of what was tuned.
    EXPECT_LT(std::abs(std::log(fresh.limits(j).acceleration / old.limits(j).acceleration)),
              std::log(4.0));
  }
  EXPECT_EQ(report.capsule_fit.coverage, 1.0);
  EXPECT_GE(report.sphere_fit.coverage, 0.99);
  EXPECT_LE(report.spheres, 64);
  EXPECT_TRUE(report.postures.path_free);
  EXPECT_GE(pair_distance(fresh, arm_data(fresh, b.stowed)), kPairDistance_m);
  EXPECT_GE(pair_distance(fresh, arm_data(fresh, b.ready)), kPairDistance_m);
  for (const char* file : {"mpc.yaml", "route.yaml", "mapping.yaml", "control.yaml", "sim.yaml"})
    EXPECT_TRUE(fs::exists(folder_ / file)) << file;
  // The keys of every room's file are those of the file that is known to run.
  for (const char* file : {"mpc.yaml", "route.yaml", "mapping.yaml", "control.yaml", "sim.yaml"}) {
    std::vector<std::string> x = config::Section::open(original / file).keys();
    std::vector<std::string> y = config::Section::open(folder_ / file).keys();
    std::sort(x.begin(), x.end());
    std::sort(y.begin(), y.end());
    EXPECT_EQ(x, y) << file;
  }
}

TEST_F(UrdfImport, EveryGuessStandsInRobotYaml) {
  const ImportReport report = import_urdf(kUrdfs / "dummies.urdf", folder_, options("dummies"));
  const std::string yaml = text(folder_ / "robot.yaml");
  EXPECT_FALSE(report.notes.empty());
  for (const std::string& note : report.notes)
    EXPECT_NE(yaml.find(note), std::string::npos) << note;
}

TEST_F(UrdfImport, MeshesBecomePrimitivesThatHoldThem) {
  import_urdf(kUrdfs / "dummies.urdf", folder_, options("dummies"));
  const UrdfDocument before = UrdfDocument::read(kUrdfs / "dummies.urdf", {kUrdfs});
  const UrdfDocument after = UrdfDocument::read(folder_ / "robot.urdf");
  for (const Eigen::Vector3d& p : before.link("base").collisions[0].solid.surface(0.03)) {
    double nearest = 1e9;
    for (const UrdfCollision& c : after.link("base").collisions) {
      EXPECT_NE(c.solid.kind, Solid::Kind::kMesh);
      nearest = std::min(nearest, c.solid.distance(p));
    }
    EXPECT_LE(nearest, 1e-6);
  }
}

TEST_F(UrdfImport, TwiceGivesTheSameFiles) {
  import_urdf(kUrdfs / "gaps.urdf", folder_, options("gaps"));
  const std::string first = text(folder_ / "robot.yaml");
  import_urdf(kUrdfs / "gaps.urdf", folder_, options("gaps"));
  EXPECT_EQ(text(folder_ / "robot.yaml"), first);
}

}  // namespace
}  // namespace wb
