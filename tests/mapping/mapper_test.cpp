// Mapper: from depth frames and robot states to the distance field, in a room that the test can
// measure.
#include "mapping/mapper.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <random>

#include "core/config/config.hpp"
#include "core/rt/allocation_count.hpp"
#include "tests/mapping/scene.hpp"

namespace wb {
namespace {

using test::Scene;

constexpr double kVoxel = 0.1;  // m, mapping.yaml
const std::filesystem::path kRobot =
    std::filesystem::path(WB_SOURCE_DIR) / "config/robots/mabi_mobile";

std::shared_ptr<const RobotModel> mabi() {
  static const auto model = std::make_shared<const RobotModel>(RobotConfig::load(kRobot));
  return model;
}

double occupied_log_odds() {
  static const double value =
      config::Section::open(kRobot / "mapping.yaml").number("log_odds_occupied");
  return value;
}

// A room of 5 x 4 x 2.5 m around the robot with a cupboard in its corner; the floor is at 0.
Scene room() {
  Scene s;
  s.room = {{-2.53, -2.04, 0.0}, {2.47, 1.96, 2.51}};
  s.boxes = {{{1.22, 0.43, 0.0}, {2.60, 2.10, 1.68}}};
  return s;
}

// The robot, its cameras and its mapper, on a clock of 15 Hz.
struct Rig {
  std::shared_ptr<const RobotModel> model;
  Mapper mapper;
  DistanceField field;
  RobotState state;
  std::vector<DepthFrame> frames;
  std::vector<const DepthFrame*> pointers;
  std::mt19937* noise = nullptr;

  explicit Rig(std::shared_ptr<const RobotModel> robot = mabi())
      : model(std::move(robot)), mapper(model), field(mapper.make_field()) {
    state.joint_count = model->joints();
    for (int j = 0; j < model->joints(); ++j) state.q[j] = model->config().stowed[j];
    frames.resize(model->config().cameras.size());
    for (std::size_t c = 0; c < frames.size(); ++c) {
      frames[c].camera = static_cast<int>(c);
      frames[c].intrinsics = model->config().cameras[c].intrinsics;
    }
    for (const DepthFrame& f : frames) pointers.push_back(&f);
  }

  RobotModel::Data kinematics() const {
    std::array<double, kMaxStates> x{};
    for (int i = 0; i < 3; ++i) x[i] = state.base[i];
    for (int j = 0; j < model->joints(); ++j) x[3 + j] = state.q[j];
    RobotModel::Data data;
    model->forward_kinematics(x.data(), data);
    return data;
  }

  // What the cameras see now.
  void look(const Scene& scene) {
    state.t_ns += kNanosPerSecond / 15;
    mapper.push_state(state);
    const RobotModel::Data data = kinematics();
    for (DepthFrame& f : frames) {
      f.t_ns = state.t_ns;
      render(scene, model->X_WF(model->frame(model->config().cameras[f.camera].name), data), f,
             noise);
    }
  }

  MapReport update() {
    const MapReport report = mapper.update(pointers, field);
    ++field.seq;
    return report;
  }

  MapReport step(const Scene& scene) {
    look(scene);
    return update();
  }

  // Turns once around and drives a little, so that every surface is seen.
  void look_around(const Scene& scene) {
    for (int n = 0; n < 24; ++n) {
      state.base = {0.3 * std::sin(0.4 * n), 0.2 * std::cos(0.4 * n), 2 * M_PI * n / 12};
      step(scene);
    }
  }
};

// Every point of a grid with 5 cm spacing in the room's free space, above the floor's influence.
template <class Visit>
void for_each_free_point(const Scene& scene, Visit visit) {
  for (double z = 0.3; z < 1.3; z += 0.05) {
    for (double y = scene.room.low.y() + 0.02; y < scene.room.high.y(); y += 0.05) {
      for (double x = scene.room.low.x() + 0.02; x < scene.room.high.x(); x += 0.05) {
        const Eigen::Vector3d p(x, y, z);
        if (scene.free(p)) visit(p);
      }
    }
  }
}

TEST(Mapper, FieldOfARoomIsWithinItsStatedBound) {
  const Scene scene = room();
  Rig rig;
  rig.look_around(scene);
  // mapper.hpp, "What a consumer can rely on": at a voxel's centre the voxel of the nearest surface
  // point is at most sqrt(3)/2 voxel off that point, the face half a voxel before its centre;
  // between centres the interpolant of distances is above the distance by at most the spread of a
  // cell, and never below by more than that.
  const double half_diagonal = 0.5 * std::sqrt(3.0) * kVoxel;
  const double above = half_diagonal - 0.5 * kVoxel + half_diagonal;
  const double below = half_diagonal + 0.5 * kVoxel + half_diagonal;
  double sum = 0;
  int count = 0;
  for_each_free_point(scene, [&](const Eigen::Vector3d& p) {
    const double truth = scene.distance(p);
    if (truth > 1.5) return;  // away from the truncation
    const double error = rig.field.distance(p) - truth;
    EXPECT_LE(error, above) << p.transpose();
    EXPECT_GE(error, -below) << p.transpose();
    sum += error;
    ++count;
  });
  ASSERT_GT(count, 10000);
  // On average a plane lies in the middle of its voxel: half a voxel too near.
  EXPECT_NEAR(sum / count, -0.5 * kVoxel, 0.5 * kVoxel);
}

TEST(Mapper, GradientPointsAwayFromTheNearestSurface) {
  const Scene scene = room();
  Rig rig;
  rig.look_around(scene);
  // In front of the wall at x = -2.53, far from all else.
  for (double x = -2.3; x < -1.8; x += 0.01) {
    Eigen::Vector3d gradient;
    const double d = rig.field.distance({x, 0.0, 0.8}, &gradient);
    EXPECT_NEAR(d, x + 2.53, 0.11);  // the wall lies 3 cm into its voxel of 10 cm
    EXPECT_GT(gradient.x(), 0.9);
    EXPECT_LT(std::hypot(gradient.y(), gradient.z()), 0.3);
  }
  // Behind the cupboard's front, which only unknown space follows: pushed back out.
  Eigen::Vector3d gradient;
  EXPECT_LT(rig.field.distance({1.3, 0.9, 0.45}, &gradient), 0);
  EXPECT_LT(gradient.x(), 0);
}

TEST(Mapper, FreshMapIsFreeEverywhere) {
  Rig rig;
  rig.mapper.push_state(rig.state);
  const MapReport report = rig.mapper.update({}, rig.field);
  ++rig.field.seq;
  EXPECT_EQ(report.occupied, 0);
  Eigen::Vector3d gradient;
  EXPECT_NEAR(rig.field.distance({0.4, 0.1, 0.5}, &gradient), 1.95,
              1e-5);  // the truncation, less half a voxel
  EXPECT_EQ(gradient.norm(), 0.0);
}

TEST(Mapper, UnseenSpaceIsFreeAndSurfacesAreNot) {
  const Scene scene = room();
  Rig rig;
  for (int n = 0; n < 3; ++n) rig.step(scene);
  // In the middle of the cupboard, deeper than what counts as solid behind its front: unknown,
  // hence free.
  EXPECT_EQ(rig.mapper.log_odds({1.7, 0.95, 0.45}), 0.0f);
  EXPECT_GT(rig.mapper.log_odds({1.22, 0.95, 0.45}), occupied_log_odds());
  EXPECT_LT(rig.mapper.log_odds({0.8, 0.3, 0.35}), 0.0f);
}

TEST(Mapper, RobotIsNotInItsOwnMap) {
  Scene scene = room();
  scene.boxes.clear();
  Rig rig;
  std::mt19937 noise(4);
  rig.noise = &noise;
  int on_robot = 0;
  for (int n = 0; n < 40; ++n) {
    // The arm sweeps before the cameras while the base turns.
    for (int j = 0; j < rig.model->joints(); ++j) {
      const JointLimits& limits = rig.model->limits(j);
      const double middle = 0.5 * (limits.lower + limits.upper),
                   half = 0.5 * (limits.upper - limits.lower);
      rig.state.q[j] = middle + 0.8 * half * std::sin(0.15 * n + j);
    }
    rig.state.base[2] = 0.05 * n;
    scene.robot = test::robot_tubes(*rig.model, rig.kinematics());
    on_robot += rig.step(scene).pixels_on_robot;
  }
  EXPECT_GT(on_robot, 10000);
  // The room is empty but for the robot: nothing stands further than two voxels inside its walls.
  for_each_free_point(scene, [&](const Eigen::Vector3d& p) {
    if (scene.distance(p) > 0.25) {
      EXPECT_LE(rig.mapper.log_odds(p), occupied_log_odds()) << p.transpose();
    }
  });
}

TEST(Mapper, DepartedObjectIsGoneInFourFramesAndANewOneIsThereInTwo) {
  const Scene empty = room();
  Scene occupied = empty;
  occupied.boxes.push_back({{1.31, -0.58, 0.0}, {1.68, -0.22, 1.68}});  // a person's size
  const Eigen::Vector3d front(1.31, -0.4, 0.65);
  Rig rig;
  for (int n = 0; n < 10; ++n) rig.step(empty);
  rig.pointers = {&rig.frames[0]};  // camera_front alone: one look for each frame
  const double before = rig.field.distance(front);
  EXPECT_GT(before, 0.3);
  rig.step(occupied);
  EXPECT_GT(rig.field.distance(front), 0.3);
  rig.step(occupied);
  EXPECT_LT(rig.field.distance(front), 0.1);
  for (int n = 0; n < 30; ++n) rig.step(occupied);
  for (int n = 0; n < 3; ++n) rig.step(empty);
  EXPECT_LT(rig.field.distance(front), 0.1);
  rig.step(empty);
  EXPECT_GT(rig.field.distance(front), 0.3);
}

TEST(Mapper, SurfacesHoldAndSpaceStaysFreeUnderNoise) {
  const Scene scene = room();
  Rig rig;
  std::mt19937 noise(9);
  rig.noise = &noise;
  rig.look_around(scene);
  int walls = 0, missing = 0;
  for (int n = 0; n < 20; ++n) {
    rig.step(scene);
    for_each_free_point(scene, [&](const Eigen::Vector3d& p) {
      // Noise at 3.5 m is 18 mm: six sigma along the ray and the voxel's diagonal.
      if (scene.distance(p) > 6 * 0.018 + std::sqrt(3.0) * kVoxel) {
        EXPECT_LE(rig.mapper.log_odds(p), occupied_log_odds()) << p.transpose();
      }
    });
    // The cupboard's front, which faces the robot.
    for (double z = 0.25; z < 0.8; z += kVoxel) {
      for (double y = 0.55; y < 1.3; y += kVoxel) {
        ++walls;
        missing += rig.field.distance({1.15, y, z}) > 0.2;
      }
    }
  }
  EXPECT_EQ(missing, 0) << "of " << walls;
}

TEST(Mapper, MovingWindowKeepsWhatStandsStill) {
  Scene scene = room();
  scene.room = {{-2.53, -2.04, 0.0}, {7.47, 1.96, 2.51}};
  Rig rig;
  for (int n = 0; n < 60; ++n) {
    rig.state.base[0] = 0.08 * n;
    rig.step(scene);
    // The window holds the robot's surroundings at every moment.
    EXPECT_LE(std::abs(rig.field.origin_W.x() + 4.0 - rig.state.base[0]), 0.5 + kVoxel + 1e-9);
  }
  // The cupboard was passed and is out of sight, the wall behind the start has left the window.
  EXPECT_LT(rig.field.distance({1.22, 0.9, 0.45}), 0.1);
  EXPECT_EQ(rig.mapper.log_odds({-2.53, 0.0, 0.5}), 0.0f);
}

TEST(Mapper, PoseIsTakenAtTheFramesStamp) {
  const Scene scene = room();
  Rig rig;
  for (int n = 0; n < 4; ++n) {
    rig.look(scene);
    // By the time the frames arrive the robot has turned on: 50 ms at 1 rad/s.
    for (int tick = 0; tick < 20; ++tick) {
      rig.state.t_ns += 2'500'000;
      rig.state.base[2] += 0.0025;
      rig.mapper.push_state(rig.state);
    }
    rig.update();
  }
  // With the pose of now the wall 2.5 m away would be off by 12 cm; its points hold the bound of a
  // static robot.
  for (double y = -1.5; y < 1.5; y += 0.1) {
    EXPECT_NEAR(rig.field.distance({-2.2, y, 0.8}), std::min(0.33, scene.distance({-2.2, y, 0.8})),
                0.11);
  }
}

TEST(Mapper, FramesWithoutPoseAreCountedAndChangeNothing) {
  const Scene scene = room();
  Rig rig;
  for (int n = 0; n < 5; ++n) rig.step(scene);
  const std::vector<float> before(rig.field.data(), rig.field.data() + 80 * 80 * 30);
  const TimeNs stamp = rig.field.t_ns;
  Scene other = scene;
  other.boxes.push_back({{1.0, -1.0, 0.0}, {1.2, 0.0, 1.5}});
  const RobotModel::Data data = rig.kinematics();
  for (DepthFrame& f : rig.frames) {
    render(other,
           rig.model->X_WF(rig.model->frame(rig.model->config().cameras[f.camera].name), data), f);
  }
  rig.frames[0].t_ns = rig.state.t_ns + 5'000'001;  // from the future
  rig.frames[1].t_ns = -1;                          // older than the history
  rig.frames[2].camera = 99;                        // no camera of this robot
  rig.frames[3].depth.pop_back();                   // not the size that it claims
  rig.frames[4].intrinsics.fx = std::numeric_limits<double>::quiet_NaN();
  DepthFrame endless = rig.frames[4];
  endless.intrinsics = rig.frames[3].intrinsics;
  endless.intrinsics.range_max_m = std::numeric_limits<double>::infinity();
  rig.pointers.push_back(&endless);
  const MapReport report = rig.update();
  EXPECT_EQ(report.frames, 0);
  EXPECT_EQ(report.frames_without_pose, 6);
  EXPECT_TRUE(std::equal(before.begin(), before.end(), rig.field.data()));
  EXPECT_EQ(rig.field.t_ns, stamp);
}

TEST(Mapper, BrokenPixelsAndStatesLeaveAFiniteField) {
  const Scene scene = room();
  Rig rig;
  rig.step(scene);
  RobotState broken = rig.state;
  broken.t_ns += 1'000'000;
  broken.base[0] = std::numeric_limits<double>::infinity();
  rig.mapper.push_state(broken);
  rig.look(scene);
  const float strange[] = {std::numeric_limits<float>::quiet_NaN(), -1.0f, 0.0f, 1e30f,
                           -std::numeric_limits<float>::infinity()};
  for (std::size_t i = 0; i < rig.frames[0].depth.size(); ++i)
    rig.frames[0].depth[i] = strange[i % 5];
  EXPECT_EQ(rig.update().frames, 5);
  for (int i = 0; i < 80 * 80 * 30; ++i) ASSERT_TRUE(std::isfinite(rig.field.data()[i]));
}

TEST(Mapper, PixelsWithoutReturnClearOnlyWhereConfigured) {
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / "wb_mapper_carve";
  std::filesystem::create_directories(folder);
  std::ifstream in(kRobot / "mapping.yaml");
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const std::string key = "no_return_carve_m: 0.0";
  ASSERT_NE(text.find(key), std::string::npos);
  text.replace(text.find(key), key.size(), "no_return_carve_m: 2.0");
  std::ofstream(folder / "mapping.yaml") << text;
  RobotConfig config = RobotConfig::load(kRobot);
  config.folder = folder;

  const Eigen::Vector3d near(1.5, 0.0, 0.6), far(3.0, 0.0, 1.2);
  for (const bool carve : {false, true}) {
    Rig rig(carve ? std::make_shared<const RobotModel>(config) : mabi());
    rig.look(room());
    for (DepthFrame& f : rig.frames) {
      f.depth.assign(f.depth.size(), std::numeric_limits<float>::infinity());
    }
    rig.update();
    EXPECT_EQ(rig.mapper.log_odds(near) < 0, carve);
    EXPECT_EQ(rig.mapper.log_odds(far), 0.0f);
  }
}

TEST(Mapper, UpdateAllocatesNothing) {
  const Scene scene = room();
  Rig rig;
  for (int n = 0; n < 12; ++n) {
    rig.state.base[0] = 0.2 * n;  // the window rolls on the way
    rig.look(scene);
    const std::uint64_t before = thread_allocations();
    rig.mapper.push_state(rig.state);
    rig.update();
    EXPECT_EQ(thread_allocations(), before);
  }
  const std::uint64_t before = thread_allocations();
  rig.mapper.reset();
  EXPECT_EQ(thread_allocations(), before);
}

TEST(Mapper, SameInputsYieldTheSameBits) {
  const Scene scene = room();
  Rig a, b;
  std::mt19937 noise_a(1), noise_b(1);
  a.noise = &noise_a;
  b.noise = &noise_b;
  for (int n = 0; n < 6; ++n) {
    a.state.base[0] = b.state.base[0] = 0.15 * n;
    a.step(scene);
    b.step(scene);
    ASSERT_TRUE(std::equal(a.field.data(), a.field.data() + 80 * 80 * 30, b.field.data()));
  }
  // And after a reset the map starts as it first did, in a window that is already in place.
  a.mapper.reset();
  EXPECT_EQ(a.mapper.update({}, a.field).occupied, 0);
}

TEST(Mapper, WrongConfigurationNamesFileAndKey) {
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / "wb_mapper_config";
  std::filesystem::create_directories(folder);
  std::ifstream in(kRobot / "mapping.yaml");
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const std::string key = "recentre_m: 0.5";
  ASSERT_NE(text.find(key), std::string::npos);
  text.replace(text.find(key), key.size(), "recentre_m: 3.9");
  std::ofstream(folder / "mapping.yaml") << text;
  RobotConfig config = RobotConfig::load(kRobot);
  config.folder = folder;
  try {
    Mapper mapper(std::make_shared<const RobotModel>(config));
    FAIL() << "accepted";
  } catch (const config::ConfigError& e) {
    EXPECT_NE(std::string(e.what()).find("mapping.yaml:5"), std::string::npos) << e.what();
    EXPECT_NE(std::string(e.what()).find("recentre_m"), std::string::npos) << e.what();
  }
}

}  // namespace
}  // namespace wb
