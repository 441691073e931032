// MotionPlanner: route and solver put together; what the two do themselves is tested beside them.
#include "planning/motion_planner.hpp"

#include <gtest/gtest.h>

#include "core/rt/allocation_count.hpp"

namespace wb {
namespace {

struct Rig {
  std::shared_ptr<const RobotModel> model = std::make_shared<const RobotModel>(
      RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile"));
  MotionPlanner planner{model};
  RobotState state;
  Reference reference;
  Policy policy;
  SolveReport report;

  Rig() {
    state.t_ns = kNanosPerSecond;
    state.joint_count = model->joints();
    std::copy(model->config().stowed.begin(), model->config().stowed.end(), state.q.begin());
    state.q_command = state.q;
    reference.seq = 17;
    reference.joint_count = model->joints();
    std::copy(model->config().stowed.begin(), model->config().stowed.end(),
              reference.posture.begin());
  }
  void drive_to(double x, double y, double yaw) {
    reference.base_goal_active = true;
    reference.base_goal = {x, y, yaw};
  }
  SolveStatus step() { return planner.step(state, reference, nullptr, policy, report); }
};

TEST(MotionPlanner, PolicyStartsAtTheBaseAndTheSetPoints) {
  Rig rig;
  rig.state.base = {0.1, -0.2, 0.3};
  rig.state.q[0] += 0.05;  // measured: the servo lags
  rig.drive_to(2, 0, 0);
  ASSERT_NE(rig.step(), SolveStatus::kNotFinite);
  EXPECT_EQ(rig.policy.t_ns, rig.state.t_ns);
  EXPECT_EQ(rig.policy.reference_seq, 17u);
  EXPECT_EQ(rig.policy.field_seq, 0u);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(rig.policy.x(0)[i], rig.state.base[i], 1e-12);
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(rig.policy.x(0)[3 + i], rig.state.q_command[i], 1e-12);
}

TEST(MotionPlanner, RouteIsAddedWhereTheReferenceAsksForOne) {
  Rig rig;
  (void)rig.step();
  EXPECT_EQ(rig.planner.expanded_reference().base_count, 0);
  rig.drive_to(2, 0, 0);
  (void)rig.step();
  EXPECT_GT(rig.planner.expanded_reference().base_count, 10);
  EXPECT_EQ(rig.reference.base_count, 0) << "the caller's reference stays as it is";
}

TEST(MotionPlanner, PolicyDrivesAlongTheRoute) {
  Rig rig;
  rig.drive_to(2, 0, 0);
  for (int i = 0; i < 5; ++i) (void)rig.step();
  const double x_end = rig.policy.x(rig.policy.nodes - 1)[0];
  EXPECT_GT(x_end, 1.0) << "2 m take less than the horizon of 4 s";
  EXPECT_LT(x_end, 2.2);
  EXPECT_NEAR(rig.policy.x(rig.policy.nodes - 1)[1], 0.0, 0.1);
}

TEST(MotionPlanner, StepDoesNotAllocate) {
  Rig rig;
  rig.drive_to(2, 1, 0);
  (void)rig.step();
  const std::uint64_t before = thread_allocations();
  (void)rig.step();
  EXPECT_EQ(thread_allocations(), before);
}

}  // namespace
}  // namespace wb
