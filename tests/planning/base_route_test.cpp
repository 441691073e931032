// BaseRoute on maps whose distances are exact: boxes on the floor of an 8 m by 8 m window.
#include "planning/base_route.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "core/model/robot_config.hpp"
#include "core/rt/allocation_count.hpp"

namespace wb {
namespace {

using Vector2 = Eigen::Vector2d;
using Base = std::array<double, 3>;

struct Box {
  Vector2 low, high;

  double distance(const Vector2& p) const {
    const Vector2 outside = (low - p).cwiseMax(p - high);
    return outside.cwiseMax(0.0).norm() + std::min(0.0, outside.maxCoeff());
  }
};

double clearance(const std::vector<Box>& boxes, const Vector2& p) {
  double d = DistanceField::kNoMap;
  for (const Box& b : boxes) d = std::min(d, b.distance(p));
  return d;
}

constexpr double kResolution = 0.1;  // m
// A cell knows the clearance of its centre only; elsewhere in it the true one is less by up to half
// its diagonal.
constexpr double kHalfCell = kResolution * M_SQRT1_2;
constexpr double kKeyframeS = 0.1;  // between keyframes

// Boxes from the floor to the ceiling.
DistanceField field_of(const std::vector<Box>& boxes) {
  static std::uint64_t seq = 0;
  DistanceField f({80, 80, 16}, kResolution);
  f.seq = ++seq;
  f.origin_W = {-4.0, -4.0, -0.2};
  for (int k = 0; k < 16; ++k) {
    for (int j = 0; j < 80; ++j) {
      for (int i = 0; i < 80; ++i) {
        const Vector2 p(-4.0 + (i + 0.5) * kResolution, -4.0 + (j + 0.5) * kResolution);
        f.at(i, j, k) = static_cast<float>(clearance(boxes, p));
      }
    }
  }
  return f;
}

double wrap(double a) { return std::remainder(a, 2 * M_PI); }

struct Rig {
  RobotConfig robot = RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile");
  config::Section section = config::Section::open(robot.folder / "route.yaml");
  BaseRoute route{robot.base, section};
  Reference reference;

  void plan(const Base& from, const std::array<double, 2>& velocity, const Base& goal,
            const DistanceField* field, TimeNs t0 = 7 * kNanosPerSecond) {
    reference.base_goal_active = true;
    reference.base_goal = goal;
    route.plan(t0, from, {velocity[0], 0, velocity[1]}, field, reference);
  }
  const Base& at(int i) const { return reference.base[i].base; }
  Vector2 position(int i) const { return {at(i)[0], at(i)[1]}; }

  // Signed speed along the heading and yaw rate between keyframes i and i + 1.
  std::array<double, 2> velocity(int i) const {
    const Base &a = at(i), &b = at(i + 1);
    const double yaw = 0.5 * (a[2] + b[2]);
    return {((b[0] - a[0]) * std::cos(yaw) + (b[1] - a[1]) * std::sin(yaw)) / kKeyframeS,
            (b[2] - a[2]) / kKeyframeS};
  }
  // Speeds, accelerations and the rolling constraint, from one keyframe to the next.
  void expect_drivable(const std::array<double, 2>& start_velocity) const {
    const BaseConfig& b = robot.base;
    std::array<double, 2> before = start_velocity;
    for (int i = 0; i + 1 < reference.base_count; ++i) {
      ASSERT_EQ(reference.base[i + 1].t_ns - reference.base[i].t_ns, from_seconds(kKeyframeS));
      const std::array<double, 2> v = velocity(i);
      ASSERT_LE(std::abs(v[0]), b.velocity_max + 1e-9);
      ASSERT_LE(std::abs(v[1]), b.yaw_rate_max + 1e-9);
      // Means of two intervals differ by at most what the limit allows in one; of the first and the
      // start, in half of one.
      ASSERT_LE(std::abs(v[0] - before[0]), b.acceleration_max * kKeyframeS + 1e-9)
          << "keyframe " << i;
      ASSERT_LE(std::abs(v[1] - before[1]), b.yaw_acceleration_max * kKeyframeS + 1e-9)
          << "keyframe " << i;
      // No rolling sideways: of a chord over a turn by w dt at most v w dt^2 / 8 points across the
      // mean heading, more when the yaw rate changes meanwhile: then by w' dt^2 / 8 of the way.
      const double yaw = 0.5 * (at(i)[2] + at(i + 1)[2]);
      const Vector2 d = position(i + 1) - position(i);
      const double sideways = std::abs(-std::sin(yaw) * d.x() + std::cos(yaw) * d.y());
      const double way = b.velocity_max * kKeyframeS;
      ASSERT_LE(
          sideways,
          way * (b.yaw_rate_max * kKeyframeS + b.yaw_acceleration_max * kKeyframeS * kKeyframeS) /
              8);
      before = v;
    }
  }
  double least_clearance(const std::vector<Box>& boxes) const {
    double least = DistanceField::kNoMap;
    for (int i = 0; i < reference.base_count; ++i)
      least = std::min(least, clearance(boxes, position(i)));
    return least;
  }
};

// Plans at 30 Hz and moves along each plan until it is there; returns the last pose, and the least
// clearance on the way.
Base drive(Rig& rig, Base pose, const Base& goal, const DistanceField* field,
           const std::vector<Box>& boxes, double seconds, double& least) {
  std::array<double, 2> velocity{};
  least = DistanceField::kNoMap;
  for (int step = 0; step < seconds * 10; ++step) {
    rig.plan(pose, velocity, goal, field);
    rig.expect_drivable(velocity);
    if (testing::Test::HasFatalFailure()) return pose;
    // One keyframe on; its velocity is the mean of the intervals on both sides.
    const std::array<double, 2> a = rig.velocity(0), b = rig.velocity(1);
    velocity = {0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])};
    pose = rig.at(1);
    least = std::min(least, clearance(boxes, {pose[0], pose[1]}));
  }
  return pose;
}

void expect_at(const Base& pose, const Base& goal) {
  EXPECT_LE(std::hypot(pose[0] - goal[0], pose[1] - goal[1]),
            0.05);  // where the route stops driving and turns
  EXPECT_LE(std::abs(wrap(pose[2] - goal[2])), 0.02);
}

const std::vector<Box> kTable = {{{0.6, -0.8}, {1.6, 0.8}}};

// The omnidirectional base's: straight to where it must go, turning on the way.
TEST(BaseRoute, AnOmnidirectionalBaseGoesSidewaysWhileItTurns) {
  const RobotConfig robot = RobotConfig::load(WB_SOURCE_DIR "/config/robots/ridgeback_ur5");
  BaseRoute route(robot.base, config::Section::open(robot.folder / "route.yaml"));
  const Base goal = {0.4, 2.0, 1.2};
  Reference reference;
  reference.base_goal_active = true;
  reference.base_goal = goal;
  Base pose = {0, 0, 0};
  std::array<double, 3> velocity{};
  double off_line = 0;
  for (int step = 0; step < 60; ++step) {
    route.plan(step * from_seconds(kKeyframeS), pose, velocity, nullptr, reference);
    std::array<double, 3> before = velocity;
    for (int i = 0; i + 1 < reference.base_count; ++i) {
      const Base &a = reference.base[i].base, &b = reference.base[i + 1].base;
      const Vector2 v_B = Eigen::Rotation2Dd(-0.5 * (a[2] + b[2])) *
                          Vector2((b[0] - a[0]) / kKeyframeS, (b[1] - a[1]) / kKeyframeS);
      const std::array<double, 3> v = {v_B.x(), v_B.y(), (b[2] - a[2]) / kKeyframeS};
      // Mean velocities of two intervals, seen from a base that turns between them.
      const double turning = robot.base.yaw_rate_max * robot.base.velocity_max * kKeyframeS;
      for (int k = 0; k < 3; ++k) {
        const double fastest = k == 2 ? robot.base.yaw_rate_max : robot.base.velocity_max;
        const double hardest =
            k == 2 ? robot.base.yaw_acceleration_max : robot.base.acceleration_max;
        ASSERT_LE(std::abs(v[k]), fastest + 1e-9);
        ASSERT_LE(std::abs(v[k] - before[k]), hardest * kKeyframeS + (k == 2 ? 1e-9 : turning));
      }
      // The velocity at the next keyframe is the mean of the intervals on both sides: that of the
      // first alone is half an interval old, and a base that believes it brakes too late.
      if (i == 1)
        velocity = {(before[0] + v[0]) / 2, (before[1] + v[1]) / 2, (before[2] + v[2]) / 2};
      before = v;
    }
    pose = reference.base[1].base;
    off_line = std::max(
        off_line, std::abs(goal[1] * pose[0] - goal[0] * pose[1]) / std::hypot(goal[0], goal[1]));
  }
  EXPECT_LE(std::hypot(pose[0] - goal[0], pose[1] - goal[1]), 0.01);
  EXPECT_LE(std::abs(wrap(pose[2] - goal[2])), 0.01);
  EXPECT_LE(off_line, 0.1);
}

TEST(BaseRoute, LeadsStraightWithoutAMap) {
  Rig rig;
  const DistanceField empty;
  for (const DistanceField* field : {static_cast<const DistanceField*>(nullptr), &empty}) {
    rig.plan({0, 0, 0}, {0, 0}, {2, 0, 0}, field);
    EXPECT_EQ(rig.route.waypoint_count(), 2);
    EXPECT_GT(rig.reference.base_count, 10);
    for (int i = 0; i < rig.reference.base_count; ++i) {
      EXPECT_NEAR(rig.at(i)[1], 0, 1e-9);
      EXPECT_NEAR(rig.at(i)[2], 0, 1e-9);
    }
    EXPECT_NEAR(rig.at(rig.reference.base_count - 1)[0], 2.0, 0.05);
  }
}

TEST(BaseRoute, LeadsStraightWhereTheWayIsClear) {
  Rig rig;
  const DistanceField field = field_of({{{-1, 2.5}, {1, 3.5}}});
  rig.plan({-2, 0, 0}, {0, 0}, {2, 0.5, 0}, &field);
  EXPECT_EQ(rig.route.waypoint_count(), 2);
  EXPECT_EQ(rig.route.waypoint(0), Vector2(-2, 0));
  EXPECT_EQ(rig.route.waypoint(1), Vector2(2, 0.5));
}

TEST(BaseRoute, StartsAtTheRobotsPoseAndVelocity) {
  Rig rig;
  const DistanceField field = field_of(kTable);
  const Base start = {-1.5, 0.3, 1.1};
  const std::array<double, 2> velocity = {0.5, -0.4};
  rig.plan(start, velocity, {3, 0, 0}, &field, 123456789);
  EXPECT_EQ(rig.reference.base[0].t_ns, 123456789);
  EXPECT_EQ(rig.at(0), start);
  rig.expect_drivable(velocity);
}

TEST(BaseRoute, GoesRoundATableWithRoomToSpare) {
  const DistanceField field = field_of(kTable);
  for (const double y : {0.3, -0.3, 0.0}) {
    Rig rig;
    double least;
    const Base goal = {3.0, 0.1, 0.5};
    const Base end = drive(rig, {-1.0, y, 0}, goal, &field, kTable, 20, least);
    expect_at(end, goal);
    EXPECT_GE(least, rig.robot.base.bounding_radius_m);
  }
}

TEST(BaseRoute, EveryKeyframeOfEveryPlanIsClearOfTheTable) {
  const DistanceField field = field_of(kTable);
  Rig rig;
  Base pose = {-1.0, 0.3, 0};
  std::array<double, 2> velocity{};
  for (int step = 0; step < 120; ++step) {
    rig.plan(pose, velocity, {3.0, 0.1, 0.5}, &field);
    ASSERT_GE(rig.least_clearance(kTable), rig.robot.base.bounding_radius_m) << "plan " << step;
    velocity = {0.5 * (rig.velocity(0)[0] + rig.velocity(1)[0]),
                0.5 * (rig.velocity(0)[1] + rig.velocity(1)[1])};
    pose = rig.at(1);
  }
}

TEST(BaseRoute, PassesThroughADoorwayInItsMiddle) {
  // 1.4 m wide in a wall across the window: 0.15 m to spare on either side.
  const std::vector<Box> walls = {{{0.9, -4.0}, {1.1, -0.7}}, {{0.9, 0.7}, {1.1, 4.0}}};
  const DistanceField field = field_of(walls);
  Rig rig;
  double least;
  const Base goal = {3.0, 1.5, 0};
  expect_at(drive(rig, {-1.5, 1.5, 0}, goal, &field, walls, 25, least), goal);
  EXPECT_GE(least, rig.robot.base.bounding_radius_m - kHalfCell);
}

TEST(BaseRoute, GapThatIsTooNarrowIsPassedBy) {
  // 1.0 m straight ahead, less than the robot's circle of 1.1 m; 1.6 m wide farther off.
  const std::vector<Box> walls = {
      {{0.9, -4.0}, {1.1, -0.5}}, {{0.9, 0.5}, {1.1, 1.6}}, {{0.9, 3.2}, {1.1, 4.0}}};
  const DistanceField field = field_of(walls);
  Rig rig;
  double least;
  const Base goal = {3.0, 0.0, 0};
  expect_at(drive(rig, {-1.0, 0, 0}, goal, &field, walls, 25, least), goal);
  EXPECT_GE(least, rig.robot.base.bounding_radius_m);
}

TEST(BaseRoute, KeepsItsComfortableDistanceWhereThatCostsLittle) {
  // A straight line would pass the corner at the circle's radius and a bit more; swerving costs
  // centimetres.
  const std::vector<Box> corner = {{{-0.5, -4.0}, {0.5, -0.65}}};
  const DistanceField field = field_of(corner);
  Rig rig;
  double least;
  const Base goal = {3.0, 0.0, 0};
  expect_at(drive(rig, {-3.0, 0, 0}, goal, &field, corner, 15, least), goal);
  EXPECT_GE(least, 0.8 - kHalfCell) << "comfort_m of route.yaml";
}

TEST(BaseRoute, WhereNoClearPathIsKnownItStillLeadsToTheGoal) {
  const std::vector<Box> wall = {{{0.9, -4.0}, {1.1, 4.0}}};
  const DistanceField field = field_of(wall);
  Rig rig;
  rig.plan({0, 0, 0}, {0, 0}, {2, 0, 0}, &field);
  EXPECT_EQ(rig.route.waypoint(rig.route.waypoint_count() - 1), Vector2(2, 0));
}

TEST(BaseRoute, EscapesFromTooCloseToAnObstacle) {
  const DistanceField field = field_of(kTable);
  Rig rig;
  double least;
  const Base goal = {-2.5, 2.0, M_PI / 2};
  const Base end = drive(rig, {0.2, 0.0, 0.0}, goal, &field, kTable, 20, least);
  expect_at(end, goal);
  EXPECT_GE(least, 0.4 - kHalfCell) << "and never closer than at the start";
}

TEST(BaseRoute, EndsAtTheGoalWithTheGoalsYaw) {
  for (const Base& goal : {Base{1, 1, 2.0}, Base{-1.5, 0.5, -3.0}, Base{0, -2, 0},
                           Base{0.01, 0.01, 3.1}, Base{2, 0, 0}}) {
    for (const double yaw :
         {0.0, 1.5, -2.5, 7.0}) {  // yaw is continuous: 7 rad is more than a turn
      Rig rig;
      double least;
      const Base end = drive(rig, {0, 0, yaw}, goal, nullptr, {}, 15, least);
      expect_at(end, goal);
      if (HasFailure()) return;
    }
  }
}

TEST(BaseRoute, BacksUpOverAShortDistanceAndTurnsForALongOne) {
  Rig rig;
  rig.plan({0, 0, 0}, {0, 0}, {-0.3, 0.02, 0}, nullptr);
  rig.expect_drivable({0, 0});
  for (int i = 0; i < rig.reference.base_count; ++i) EXPECT_LE(std::abs(rig.at(i)[2]), 0.3);
  EXPECT_LE(rig.velocity(3)[0], -0.1);
  rig.plan({0, 0, 0}, {0, 0}, {-2.0, 0.02, 0}, nullptr);
  double turned = 0;
  for (int i = 0; i < rig.reference.base_count; ++i)
    turned = std::max(turned, std::abs(rig.at(i)[2]));
  EXPECT_GE(turned, 2.5);
}

TEST(BaseRoute, OnlyTheSliceThatTheRobotCanTouchCounts) {
  DistanceField field = field_of(kTable);
  const DistanceField blocked = field;
  for (int k = 0; k < 16; ++k) {  // the same table top, 1.3 m above the floor
    const double z = field.origin_W.z() + (k + 0.5) * kResolution;
    for (int i = 0; i < 80 * 80; ++i) {
      if (z < 1.2)
        field.data()[field.index(0, 0, k) + i] = static_cast<float>(DistanceField::kNoMap);
    }
  }
  field.seq = 1000000;
  Rig rig;
  rig.plan({-1, 0, 0}, {0, 0}, {3, 0, 0}, &blocked);
  EXPECT_GT(rig.route.waypoint_count(), 2);
  rig.plan({-1, 0, 0}, {0, 0}, {3, 0, 0}, &field);
  EXPECT_EQ(rig.route.waypoint_count(), 2);
}

TEST(BaseRoute, PlanDoesNotAllocate) {
  const DistanceField field = field_of(kTable), other = field_of(kTable);
  Rig rig;
  const std::uint64_t before = thread_allocations();
  rig.plan({-1, 0.3, 0}, {0, 0}, {3, 0.1, 0.5}, &field);
  rig.plan({-1, 0.3, 0}, {0, 0}, {3, 0.1, 0.5}, &other);
  EXPECT_EQ(thread_allocations(), before);
  EXPECT_GT(rig.route.waypoint_count(), 2) << "it searched";
}

}  // namespace
}  // namespace wb
