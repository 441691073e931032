// Milestone A: the arm reaches a posture and holds it, the base drives and turns, by the
// simulator's truth.
#include <gtest/gtest.h>

#include <numbers>

#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::SimulatedRun;

// Two metres of free floor in front.
constexpr char kFreeFloor[] = "{x_m: -1.5, y_m: -1.2, yaw_rad: 0}";

constexpr double kBase_m = 0.03, kBase_rad = 2 * std::numbers::pi / 180;
constexpr double kArm_rad = 0.02;

void expect_base_at(const SimulatedRun& run, const std::array<double, 3>& goal) {
  const Eigen::Isometry3d X_WB = run.base();
  EXPECT_LT(std::hypot(X_WB(0, 3) - goal[0], X_WB(1, 3) - goal[1]), kBase_m);
  EXPECT_LT(std::abs(std::remainder(test::yaw(X_WB) - goal[2], 2 * std::numbers::pi)), kBase_rad);
  EXPECT_EQ(run.contacts(), 0u) << run.contact_names();
}

void expect_arm_at(SimulatedRun& run, const std::vector<double>& q) {
  for (std::size_t i = 0; i < q.size(); ++i) {
    EXPECT_NEAR(run.system().state().q[i], q[i], kArm_rad) << "joint " << i;
  }
  EXPECT_EQ(run.contacts(), 0u) << run.contact_names();
}

TEST(Motion, BaseDrivesAMetreForwardAndTurnsAQuarter) {
  SimulatedRun run({.spawn = kFreeFloor});
  run.reset();
  for (const double turn : {0.0, 0.5 * std::numbers::pi}) {
    const std::array<double, 3> goal{1, 0, turn};
    const std::uint64_t id = run.move_base(goal);
    ASSERT_TRUE(run.run_to_end(id, 20)) << run.status(id).reason.view();
    expect_base_at(run, goal);
    run.run_for(1);  // and stands there
    expect_base_at(run, goal);
  }
}

TEST(Motion, ArmReachesAPostureAndHoldsIt) {
  SimulatedRun run({.spawn = kFreeFloor});
  const auto& robot = run.system().model().config();
  run.reset();
  for (const std::vector<double>& q : {robot.ready, robot.stowed}) {
    const std::uint64_t id = run.move_joints(q);
    ASSERT_TRUE(run.run_to_end(id, 20)) << run.status(id).reason.view();
    expect_arm_at(run, q);
    run.run_for(1);
    const test::Posture settled = run.posture();
    run.run_for(1);
    expect_arm_at(run, q);
    EXPECT_LT(between(settled, run.posture()).joint_rad, 0.002);
    expect_base_at(run, {0, 0, 0});
  }
}

TEST(Motion, SecondRunGivesTheSameStateHash) {
  const auto hash = [] {
    SimulatedRun run({.spawn = kFreeFloor});
    run.reset();
    EXPECT_TRUE(run.run_to_end(run.move_base({0.5, 0, 0.3}), 20));
    EXPECT_TRUE(run.run_to_end(run.move_joints(run.system().model().config().ready), 20));
    return run.system().state_hash();
  };
  EXPECT_EQ(hash(), hash());
}

}  // namespace
}  // namespace wb
