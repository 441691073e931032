// The ray caster against MuJoCo's own rays, and the cameras' stamps, delay, noise and ring.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "drivers/sim/cameras.hpp"
#include "drivers/sim/ray_caster.hpp"
#include "sim_driver.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
using test::kTick;
using test::sim_config;
using test::SimDriver;

const std::string kSpawn = "spawn: {x_m: -0.1, y_m: 0.9, yaw_rad: 0.2, posture: ready}";

double mj_depth(const sim::Plant& plant, const Eigen::Isometry3d& X_SC, const CameraIntrinsics& k,
                int u, int v) {
  const Vector3d ray =
      X_SC.linear() * Vector3d((u + 0.5 - k.cx) / k.fx, (v + 0.5 - k.cy) / k.fy, 1);
  int geom = -1;
  const double t = mj_ray(&plant.model(), &plant.data(), X_SC.translation().data(), ray.data(),
                          nullptr, 1, -1, &geom);
  return geom < 0 ? std::numeric_limits<double>::infinity() : t;
}

TEST(SimRayCaster, DepthIsThatOfMujocosRays) {
  const auto config = sim::PluginConfig::parse(sim_config(kSpawn), WB_SOURCE_DIR "/config");
  sim::Plant plant(config);
  for (int joint = 0; joint < plant.model().njnt;
       ++joint) {  // an open kitchen shows more kinds of edges
    if (plant.model().jnt_stiffness[joint] > 0) plant.set_part(joint, 0.3);
  }
  sim::RayCaster caster(plant.model(), 160, 120);
  sim::GeomPoses poses(plant.model());
  poses.take(plant.data(), 0);
  int compared = 0, grazing = 0;
  for (const CameraConfig& camera : config.robot.cameras) {
    const Eigen::Isometry3d X_SC = plant.X_S(plant.body(camera.name));
    const CameraIntrinsics& k = camera.intrinsics;
    caster.render(poses, X_SC, k);
    for (int v = 0; v < k.height; ++v) {
      for (int u = 0; u < k.width; ++u) {
        const double expected = mj_depth(plant, X_SC, k, u, v), depth = caster.depth_row(v)[u];
        ++compared;
        // Single precision over a 5 m kitchen, and rays that graze an edge within it.
        if (std::isinf(expected) != std::isinf(depth) ||
            std::abs(expected - depth) > 1e-5 * expected)
          ++grazing;
      }
    }
  }
  EXPECT_EQ(compared, 5 * 160 * 120);
  EXPECT_LE(grazing, compared / 10'000);
}

TEST(SimRayCaster, SeesEveryPrimitiveFromInsideAndOutside) {
  const char* text = R"(<mujoco><worldbody>
    <geom type="plane" size="5 5 1"/><geom type="box" pos="0 1 1" euler="20 30 0" size="0.3 0.2 0.1"/>
    <geom type="capsule" pos="1 1 1" euler="50 0 10" size="0.1 0.3"/><geom type="cylinder" pos="-1 1 1" euler="70 20 0" size="0.2 0.2"/>
    <geom type="ellipsoid" pos="0 -1 1" euler="0 40 0" size="0.3 0.2 0.1"/><geom type="sphere" pos="0 0 2" size="0.25"/>
    </worldbody></mujoco>)";
  const sim::ModelPtr model = sim::compile(text);
  const sim::DataPtr data(mj_makeData(model.get()));
  mj_forward(model.get(), data.get());
  const CameraIntrinsics k{61,   43,   30, 30,
                           30.5, 21.5, 0,  100};  // a width that is no multiple of the lanes
  sim::RayCaster caster(*model, k.width, k.height);
  sim::GeomPoses poses(*model);
  poses.take(*data, 0);
  int wrong = 0, hits = 0;
  const std::vector<Vector3d> eyes = {{0, 0, 0.5}, {0, 1, 1}, {1, 1, 1}, {-1, 1, 1},
                                      {0, -1, 1},  {0, 0, 2}, {2, -2, 3}};
  for (const Vector3d& eye : eyes) {
    for (int i = 0; i < 24; ++i) {
      Eigen::Isometry3d X_SC = Eigen::Isometry3d::Identity();
      X_SC.linear() = (Eigen::AngleAxisd(0.7 * i, Vector3d::UnitZ()) *
                       Eigen::AngleAxisd(0.4 * i, Vector3d::UnitX()))
                          .toRotationMatrix();
      X_SC.translation() = eye;
      caster.render(poses, X_SC, k);
      for (int v = 0; v < k.height; ++v) {
        for (int u = 0; u < k.width; ++u) {
          const Vector3d ray =
              X_SC.linear() * Vector3d((u + 0.5 - k.cx) / k.fx, (v + 0.5 - k.cy) / k.fy, 1);
          int geom = -1;
          const double t =
              mj_ray(model.get(), data.get(), eye.data(), ray.data(), nullptr, 1, -1, &geom);
          if (geom >= 0) ++hits;
          const double expected = geom < 0 ? std::numeric_limits<double>::infinity() : t;
          // The far plane near its horizon is left out: depths grow without bound there.
          if (expected < 50 && !(std::abs(caster.depth_row(v)[u] - expected) < 1e-4)) ++wrong;
        }
      }
    }
  }
  EXPECT_GT(hits, 100'000);
  EXPECT_LE(wrong, hits / 5'000);  // rays that graze
}

TEST(SimCameras, FramesCarryTheirExposuresStampAndAppearAfterTheDelay) {
  SimDriver sim(sim_config(kSpawn));
  wb_frame frame{};
  std::vector<TimeNs> stamps;
  for (int tick = 0; tick <= 80; ++tick) {
    while (sim.api().acquire_frame(sim.get(), &frame) == WB_OK) {
      EXPECT_GE(sim.now() - frame.t_ns, 30'000'000);
      EXPECT_LT(sim.now() - frame.t_ns, 30'000'000 + kTick);
      if (frame.camera == 0) stamps.push_back(frame.t_ns);
      EXPECT_EQ(sim.api().release_frame(sim.get(), frame.token), WB_OK);
    }
    sim.advance(kTick);
  }
  ASSERT_GE(stamps.size(), 3u);
  for (std::size_t k = 0; k < stamps.size(); ++k) {
    const double due = static_cast<double>(k) * 1e9 / 15;
    EXPECT_GE(static_cast<double>(stamps[k]), due);
    EXPECT_LT(static_cast<double>(stamps[k]), due + kTick);
  }
  EXPECT_EQ(sim.api().release_frame(sim.get(), frame.token), WB_ERROR);  // twice
}

TEST(SimCameras, NoiseGrowsWithTheSquareOfDepthAndOnePercentDropsOut) {
  const auto config = sim::PluginConfig::parse(sim_config(kSpawn), WB_SOURCE_DIR "/config");
  const sim::Plant plant(config);
  sim::Cameras cameras(config, plant);
  cameras.expose(plant, 0);
  cameras.expose(plant, 0);  // not due again
  int returns = 0, dropped = 0, frames = 0;
  double sum = 0, square = 0;
  // The frames are visible 30 ms later.
  sim::Plant later(config);
  while (later.time_ns() < 40'000'000) later.step();
  cameras.expose(later, 0);
  wb_frame frame{};
  while (cameras.acquire(frame) == WB_OK) {
    ++frames;
    const CameraConfig& camera = config.robot.cameras[frame.camera];
    const CameraIntrinsics& k = camera.intrinsics;
    const Eigen::Isometry3d X_SC = plant.X_S(plant.body(camera.name));
    for (int v = 0; v < k.height; v += 2) {
      for (int u = 0; u < k.width; u += 2) {
        const double z = mj_depth(plant, X_SC, k, u, v), measured = frame.depth[v * k.width + u];
        if (!(z >= k.range_min_m && z <= k.range_max_m)) continue;
        if (std::isinf(measured)) {
          ++dropped;
          continue;
        }
        const double e = (measured - z) / (0.0015 * z * z);
        ++returns;
        sum += e;
        square += e * e;
      }
    }
  }
  EXPECT_EQ(frames, 5);
  ASSERT_GT(returns, 20'000);
  EXPECT_NEAR(sum / returns, 0.0, 4.0 / std::sqrt(returns));
  EXPECT_NEAR(std::sqrt(square / returns), 1.0,
              0.03);  // four standard errors of a deviation over 2e4 samples
  EXPECT_NEAR(static_cast<double>(dropped) / (returns + dropped), 0.01, 0.003);
}

TEST(SimCameras, ForgetTheOldestFrameThatNobodyTook) {
  SimDriver sim(sim_config(kSpawn));
  sim.advance(from_seconds(2.0));
  wb_frame frame{};
  int frames = 0;
  TimeNs newest = 0, last = 0;
  while (sim.api().acquire_frame(sim.get(), &frame) == WB_OK) {
    ++frames;
    EXPECT_GE(frame.t_ns, last);
    last = frame.t_ns;
    newest = std::max(newest, frame.t_ns);
    sim.api().release_frame(sim.get(), frame.token);
  }
  EXPECT_EQ(frames, (6 - 1) * 5);  // the ring's slots of each camera, less the one still under way
  EXPECT_EQ(sim.truth().frames_dropped(sim.get()),
            31u * 5 - 6 * 5);  // exposures 0 to 30 in 2 s, less those that are kept
  EXPECT_GE(newest, sim.now() - 30'000'000 - 66'666'667 - kTick);
}

TEST(SimCameras, ColourIsThereOnlyWhenAskedFor) {
  for (const bool colour : {false, true}) {
    SimDriver sim(sim_config(kSpawn + ", colour: " + (colour ? "true" : "false")));
    sim.advance(from_seconds(0.05));
    wb_frame frame{};
    ASSERT_EQ(sim.api().acquire_frame(sim.get(), &frame), WB_OK);
    EXPECT_EQ(frame.colour != nullptr, colour);
    EXPECT_EQ(sim.description().cameras[0].has_colour, colour ? 1u : 0u);
  }
}

TEST(SimCameras, AWorkerThreadDevelopsTheSameDepths) {
  SimDriver inside(sim_config(kSpawn)), outside(sim_config(kSpawn + ", render_thread: true"));
  wb_frame a{}, b{};
  inside.advance(0);
  outside.advance(0);
  for (int tick = 0; tick < 14; ++tick) {
    inside.advance(kTick);
    outside.advance(kTick);
  }
  for (std::uint32_t i = 0; i < inside.description().camera_count; ++i) {
    ASSERT_EQ(inside.api().acquire_frame(inside.get(), &a), WB_OK);
    while (outside.api().acquire_frame(outside.get(), &b) != WB_OK) {
      timespec pause{
          0, 1'000'000};  // the worker's time is its own; the test's time-out bounds the wait
      nanosleep(&pause, nullptr);
    }
    ASSERT_EQ(a.camera, b.camera);
    EXPECT_EQ(a.t_ns, b.t_ns);
    EXPECT_EQ(std::memcmp(a.depth, b.depth, sizeof(float) * 160 * 120), 0);
  }
}

}  // namespace
}  // namespace wb
