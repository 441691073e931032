// Scenes, spawns, ground truth, determinism, and what a bad configuration says.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <numbers>

#include "core/types/pose.hpp"
#include "drivers/sim/plant.hpp"
#include "sim_driver.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
using test::kTick;
using test::sim_config;
using test::SimDriver;

const std::string kSpawn = "spawn: {x_m: -1.0, y_m: -0.8, yaw_rad: 0.0}";

Eigen::Isometry3d isometry(const wb_sim_pose& pose) {
  return Pose{std::to_array(pose.p), std::to_array(pose.q)}.isometry();
}

class EveryScene : public testing::TestWithParam<std::string> {};

TEST_P(EveryScene, SettlesWithoutContactAndItsPartsStayShut) {
  SimDriver sim("{robot: robots/mabi_mobile, scene: scenes/" + GetParam() +
                ", seed: 3, spawn: random}");
  sim.advance(from_seconds(2.0));
  EXPECT_EQ(sim.truth().contact_count(sim.get()), 0u);
  ASSERT_GT(sim.truth().object_count(sim.get()), 0u);
  for (std::uint32_t i = 0; i < sim.truth().object_count(sim.get()); ++i) {
    wb_sim_object o{};
    sim.truth().object(sim.get(), i, &o);
    EXPECT_NEAR(o.value, 0.0, 2e-3) << o.name;
  }
}

// A handle is reached from the front, and the part moves its handle away from the unit.
TEST_P(EveryScene, TruthOfEachObjectIsConsistentWithItsMotion) {
  SimDriver sim("{robot: robots/mabi_mobile, scene: scenes/" + GetParam() +
                ", seed: 3, spawn: random}");
  for (std::uint32_t i = 0; i < sim.truth().object_count(sim.get()); ++i) {
    wb_sim_object shut{}, open{};
    sim.truth().object(sim.get(), i, &shut);
    const double value = 0.5 * shut.range;
    sim.fault().set_object(sim.get(), i, value);
    sim.truth().object(sim.get(), i, &open);
    sim.fault().set_object(sim.get(), i, 0);
    EXPECT_NEAR(open.value, value, 1e-12);
    const Vector3d axis = Eigen::Map<const Vector3d>(shut.axis),
                   origin = Eigen::Map<const Vector3d>(shut.axis_origin);
    Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
    if (shut.is_revolute) {
      motion = Eigen::Translation3d(origin) * Eigen::AngleAxisd(value, axis) *
               Eigen::Translation3d(-origin);
    } else {
      motion.translation() = value * axis;
    }
    EXPECT_LT((motion * isometry(shut.X_SG)).matrix().cwiseAbs().maxCoeff(), 10);
    EXPECT_LT(((motion * isometry(shut.X_SG)).matrix() - isometry(open.X_SG).matrix()).norm(), 1e-9)
        << shut.name;
    const Vector3d into = isometry(shut.X_SG).linear().col(2);
    EXPECT_LT((isometry(open.X_SG).translation() - isometry(shut.X_SG).translation()).dot(into),
              -0.1)
        << shut.name;
    // The moving box holds the handle, the carcass lies behind it.
    const Eigen::Isometry3d X_SM = isometry(shut.moving.X_SM);
    const Vector3d p_M = X_SM.inverse() * isometry(shut.X_SG).translation();
    EXPECT_TRUE((p_M.cwiseAbs() - Eigen::Map<const Vector3d>(shut.moving.half_extent)).maxCoeff() <
                0)
        << shut.name;
    EXPECT_GT(
        (isometry(shut.carcass.X_SM).translation() - isometry(shut.X_SG).translation()).dot(into),
        0.1)
        << shut.name;
  }
}

std::vector<std::string> scenes() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(WB_SOURCE_DIR "/config/scenes")) {
    names.push_back(entry.path().filename().string());
  }
  return names;
}
INSTANTIATE_TEST_SUITE_P(Scenes, EveryScene, testing::ValuesIn(scenes()));

TEST(SimScene, KitchenLineHasItsObjects) {
  SimDriver sim(sim_config(kSpawn));
  for (const char* name :
       {"fridge_1", "drawer_1", "drawer_2", "drawer_3", "oven_1", "dishwasher_1", "cabinet_1",
        "washing_machine_1", "cabinet_2", "cabinet_3", "cabinet_4"}) {
    EXPECT_NO_THROW(sim.object(name)) << name;
  }
  const wb_sim_object drawer = sim.object("drawer_1");
  EXPECT_NEAR(drawer.X_SG.p[0], 0.96, 2e-3);
  EXPECT_NEAR(drawer.X_SG.p[2], 0.808, 1e-9);
  EXPECT_EQ(drawer.range, 0.45);
}

TEST(SimScene, OverridesReplaceAPartsKeys) {
  const auto part = [](const std::string& more) {
    const auto config =
        sim::PluginConfig::parse(sim_config(kSpawn + more), WB_SOURCE_DIR "/config");
    for (const sim::Unit& unit : config.scene.units) {
      for (const sim::Part& p : unit.parts) {
        if (p.name == "drawer_1") return p;
      }
    }
    return sim::Part{};
  };
  EXPECT_EQ(part("").joint.friction, 4);
  EXPECT_EQ(part(", objects: {drawer_1: {friction_n: 60}}").joint.friction, 60);
}

TEST(SimScene, BadConfigurationsNameFileAndKey) {
  const auto message = [](const std::string& config) -> std::string {
    try {
      SimDriver sim(config);
      return "";
    } catch (const std::exception& e) {
      return e.what();
    }
  };
  const auto names = [&](const std::string& config, const std::string& what) {
    const std::string text = message(config);
    EXPECT_NE(text.find(what), std::string::npos) << "'" << text << "' does not name " << what;
  };
  names(sim_config(kSpawn + ", sede: 3"), "sede");
  names("{robot: robots/nobody, scene: scenes/kitchen_line.yaml, seed: 1, " + kSpawn + "}",
        "robots/nobody");
  names(sim_config(kSpawn + ", objects: {drawer_9: {friction_n: 60}}"), "drawer_9");
  names(sim_config(kSpawn + ", objects: {drawer_1: {friction: 60}}"), "friction");
  names(sim_config("spawn: somewhere"), "spawn");
  names(sim_config("spawn: {x_m: 0, y_m: 0, yaw_rad: 0, posture: [1, 2]}"), "posture");
  names("{ this is not yaml", "plugin sim");
}

TEST(SimScene, RandomSpawnsAreClearAndSpreadOverTheFreeFloor) {
  constexpr int kSpawns = 60;
  int left = 0, turned = 0;
  double x_min = 10, x_max = -10;
  for (int seed = 0; seed < kSpawns; ++seed) {
    SimDriver sim(sim_config("spawn: random", seed));
    const Eigen::Isometry3d X = isometry(sim.truth().spawn_pose(sim.get()));
    EXPECT_GE(sim.truth().clearance(sim.get(), nullptr), 0.05) << seed;
    EXPECT_EQ(sim.truth().contact_count(sim.get()), 0u) << seed;
    left += X.translation().y() > 0;
    turned += X(0, 0) < 0;
    x_min = std::min(x_min, X.translation().x());
    x_max = std::max(x_max, X.translation().x());
  }
  EXPECT_LT(x_min, -2.0);
  EXPECT_GT(x_max, 0.0);
  EXPECT_GT(left, 5);  // table and chair take most of the left
  EXPECT_LT(left, 40);
  EXPECT_NEAR(turned, kSpawns / 2, 16);  // four sigma of a coin
}

TEST(SimScene, ClearanceIsTheTrueDistance) {
  // The tower's back, 0.45 m behind the base, 0.35 m before the rear wall at x = -3.4; everything
  // else is farther.
  SimDriver sim(sim_config("spawn: {x_m: -2.6, y_m: -1.0, yaw_rad: 0.0}"));
  EXPECT_NEAR(sim.truth().clearance(sim.get(), nullptr), 0.35, 2e-3);
  EXPECT_NEAR(sim.truth().clearance(sim.get(), "drawer_1"), 0.35, 2e-3);
  EXPECT_TRUE(std::isnan(sim.truth().clearance(sim.get(), "drawer_9")));
}

TEST(SimScene, TouchesAreLoggedOncePerPair) {
  // The front of the chassis 0.25 m ahead of the base, driven into the drawers' fronts at x = 1.0.
  SimDriver sim(sim_config("spawn: {x_m: 0.55, y_m: 1.2, yaw_rad: 0.0}"));
  EXPECT_EQ(sim.truth().contact_count(sim.get()), 0u);
  ASSERT_EQ(sim.activate(), WB_OK);
  sim.run(2.0, [&](TimeNs) {
    wb_commands c{};
    for (int wheel = sim.arm(); wheel < sim.arm() + 2; ++wheel)
      c.joints[wheel] = {WB_CMD_VELOCITY, 0, 2, 0, 0, 0};
    c.gripper = {0.08, 30};
    return c;
  });
  const std::uint32_t count = sim.truth().contact_count(sim.get());
  ASSERT_GT(count, 0u);
  EXPECT_EQ(sim.truth().clearance(sim.get(), nullptr), 0.0);
  std::vector<std::string> pairs;
  for (std::uint32_t i = 0; i < count; ++i) {
    wb_sim_contact c{};
    ASSERT_EQ(sim.truth().contact(sim.get(), i, &c), WB_OK);
    pairs.push_back(std::string(c.robot_geom) + " " + c.other_geom);
    EXPECT_GT(c.t_ns, 0);
  }
  std::sort(pairs.begin(), pairs.end());
  EXPECT_EQ(std::adjacent_find(pairs.begin(), pairs.end()), pairs.end());
}

// Everything a host can see, over a run with motion and frames.
std::uint64_t run_hash(int seed, TimeNs step_ns) {
  SimDriver sim(sim_config("spawn: random", seed));
  sim.activate();
  std::uint64_t hash = 1469598103934665603ULL;
  const auto add = [&](const void* data, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i)
      hash = (hash ^ static_cast<const unsigned char*>(data)[i]) * 1099511628211ULL;
  };
  for (int i = 0; i < 40; ++i) {
    wb_commands c{};
    for (int wheel = sim.arm(); wheel < sim.arm() + 2; ++wheel)
      c.joints[wheel] = {WB_CMD_VELOCITY, 0, wheel - 6.5, 0, 0, 0};
    c.gripper = {0.04, 30};
    sim.write(c);
    for (TimeNs t = 0; t < 4 * kTick; t += step_ns) sim.advance(step_ns);
    const wb_readings r = sim.read();
    add(r.joints, sizeof(r.joints));
    add(&r.imu, sizeof(r.imu.gyro) + sizeof(r.imu.acceleration));
    wb_frame frame{};
    while (sim.api().acquire_frame(sim.get(), &frame) == WB_OK) {
      add(frame.depth, sizeof(float) * 160 * 120);
      sim.api().release_frame(sim.get(), frame.token);
    }
  }
  return hash;
}

TEST(SimScene, SameSeedAndCallsGiveTheSameBytes) {
  const std::uint64_t hash = run_hash(5, 4 * kTick);
  EXPECT_EQ(run_hash(5, 4 * kTick), hash);
  EXPECT_EQ(run_hash(5, kTick), hash);  // however the time is cut
  EXPECT_NE(run_hash(6, 4 * kTick), hash);
}

TEST(SimScene, ViewShowsMoreThanOneColour) {
  SimDriver sim(sim_config(kSpawn));
  std::vector<std::uint8_t> rgb(3 * 64 * 48);
  ASSERT_EQ(sim.view().render(sim.get(), 64, 48, nullptr, 0, rgb.data()), WB_OK);
  EXPECT_GT(*std::max_element(rgb.begin(), rgb.end()) - *std::min_element(rgb.begin(), rgb.end()),
            100);
  EXPECT_EQ(sim.view().render(sim.get(), 0, 48, nullptr, 0, rgb.data()), WB_ERROR);
}

}  // namespace
}  // namespace wb
