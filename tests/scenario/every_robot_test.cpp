// Every robot of config/robots through the whole system in lockstep: its arm reaches its postures,
// its base (if it has one) a pose, by the simulator's truth, and nothing is touched.
#include <gtest/gtest.h>

#include <numbers>

#include "tests/core/model/robots.hpp"
#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::SimulatedRun;

// Two metres of free floor in front.
constexpr char kFreeFloor[] = "{x_m: -1.5, y_m: -1.2, yaw_rad: 0}";

constexpr double kBase_m = 0.04, kBase_rad = 2 * std::numbers::pi / 180;
constexpr double kJoint = 0.02;  // rad or m

class EveryRobotMoves : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Robots, EveryRobotMoves, ::testing::ValuesIn(test::robot_names()),
                         [](const auto& info) { return info.param; });

void expect_base_at(const SimulatedRun& run, const std::array<double, 3>& goal) {
  const Eigen::Isometry3d X_WB = run.base();
  EXPECT_LT(std::hypot(X_WB(0, 3) - goal[0], X_WB(1, 3) - goal[1]), kBase_m);
  EXPECT_LT(std::abs(std::remainder(test::yaw(X_WB) - goal[2], 2 * std::numbers::pi)), kBase_rad);
}

TEST_P(EveryRobotMoves, ArmToItsPosturesAndBaseToAPose) {
  SimulatedRun run({.robot = GetParam(), .spawn = kFreeFloor});
  const RobotModel& model = run.system().model();
  run.reset();
  for (const std::vector<double>& q : {model.config().ready, model.config().stowed}) {
    const std::uint64_t id = run.move_joints(q);
    ASSERT_TRUE(run.run_to_end(id, 30)) << run.status(id).reason.view();
    run.run_for(1);  // and stays there
    for (int i = 0; i < model.joints(); ++i) {
      const double off = run.system().state().q[i] - q[i];
      EXPECT_NEAR(model.limits(i).endless() ? std::remainder(off, 2 * std::numbers::pi) : off, 0,
                  kJoint)
          << model.config().joints[i].name;
    }
    expect_base_at(run, {0, 0, 0});
  }
  const std::array<double, 3> goal = {0.9, 0.3, 0.6};
  const std::uint64_t id = run.move_base(goal);
  if (model.base_dof() == 0) {
    run.run_for(0.1);
    EXPECT_EQ(run.outcome(id), RequestOutcome::kRefused);
  } else {
    ASSERT_TRUE(run.run_to_end(id, 30)) << run.status(id).reason.view();
    run.run_for(1);
    expect_base_at(run, goal);
  }
  EXPECT_EQ(run.contacts(), 0u) << run.contact_names();
}

}  // namespace
}  // namespace wb
