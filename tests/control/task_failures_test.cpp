// TaskSequencer on the ideal plant: each phase's time limit and failure exit, missed and slipped
// grasps, and a stuck joint.
#include "control/task_sequencer.hpp"
#include "tests/control/task_fixture.hpp"

namespace wb {
namespace {

using namespace control_test;

const std::array<double, 3> kFarAway{3.0, 1.0, 0.5};

Unit drawer() { return Unit::drawer(0.4, kFarAway); }

void expect_failed(const TaskRun& run, std::string_view why) {
  EXPECT_EQ(run.last(), Phase::kFailed);
  EXPECT_EQ(run.out.failure, why);
}

// A phase that gets nowhere lasts as long as its limit: to the tick, and one for leaving it.
void expect_timed_out(const TaskRun& run, Phase phase, const char* limit) {
  EXPECT_NEAR(run.lasted(phase), Limits().time(limit), 2.5 * kTickS) << to_string(phase);
}

TEST(TaskTimeLimit, ApproachWithoutAPlanFails) {
  TaskRun run(drawer());
  run.plans = false;
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "object not found");
  expect_timed_out(run, Phase::kApproach, "approach_s");
  EXPECT_EQ(run.phases.size(), 2u);
}

TEST(TaskTimeLimit, BaseThatNeverArrivesFails) {
  TaskRun run(drawer());
  run.plant.base_moves = false;
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "time limit");
  expect_timed_out(run, Phase::kApproach, "approach_s");
}

TEST(TaskTimeLimit, HandleThatIsNeverSeenFails) {
  TaskRun run(drawer());
  run.measures = false;
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "object not found");
  expect_timed_out(run, Phase::kPreGrasp, "pre_grasp_s");
  EXPECT_EQ(run.count(Phase::kGrasp), 0);
}

// Stops the hand as long as the task is in this phase.
void freeze_hand_in(TaskRun& run, Phase phase) {
  run.every_tick = [phase](TaskRun& r) { r.plant.hand_follows = r.out.phase != phase; };
}

TEST(TaskTimeLimit, HandThatNeverGetsToThePreGraspFails) {
  TaskRun run(drawer());
  freeze_hand_in(run, Phase::kPreGrasp);
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "time limit");
  expect_timed_out(run, Phase::kPreGrasp, "pre_grasp_s");
}

TEST(TaskTimeLimit, HandThatNeverGetsToTheHandleBacksOff) {
  TaskRun run(drawer());
  freeze_hand_in(run, Phase::kGrasp);
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "time limit");
  expect_timed_out(run, Phase::kGrasp, "grasp_s");
  EXPECT_EQ(run.count(Phase::kGrasp), 1);
  EXPECT_EQ(run.count(Phase::kRetreat), 1) << "at once: the gripper is open already";
}

TEST(TaskTimeLimit, JointThatMovesTooSlowlyIsLetGo) {
  TaskRun run(drawer());
  run.plant.joint_speed_max = 0.01;
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "time limit");
  expect_timed_out(run, Phase::kManipulate, "manipulate_s");
  EXPECT_EQ(run.count(Phase::kRelease), 1);
  EXPECT_EQ(run.count(Phase::kRetreat), 1);
}

TEST(TaskTimeLimit, GripperThatDoesNotOpenEndsInARetreatAndAFailure) {
  TaskRun run(drawer());
  run.every_tick = [](TaskRun& r) { r.plant.gripper_moves = r.out.phase != Phase::kRelease; };
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "time limit");
  expect_timed_out(run, Phase::kRelease, "release_s");
  EXPECT_EQ(run.count(Phase::kRetreat), 1);
}

TEST(TaskTimeLimit, HandThatCannotBackOffFails) {
  TaskRun run(drawer());
  freeze_hand_in(run, Phase::kRetreat);
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "time limit");
  expect_timed_out(run, Phase::kRetreat, "retreat_s");
}

TEST(TaskGrasp, MissedGraspIsTriedOnceMoreAndThenFails) {
  TaskRun run(drawer());
  run.plant.bar_there = false;
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "grasp missed");
  EXPECT_EQ(run.count(Phase::kPreGrasp), 2) << "looks again before the second try";
  EXPECT_EQ(run.count(Phase::kGrasp), 2);
  EXPECT_EQ(run.count(Phase::kManipulate), 0);
}

TEST(TaskGrasp, SecondGraspThatHoldsOpensTheObject) {
  TaskRun run(drawer());
  run.plant.bar_there = false;
  run.every_tick = [](TaskRun& r) { r.plant.bar_there = r.count(Phase::kGrasp) == 2; };
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.last(), Phase::kDone);
  EXPECT_EQ(run.out.failure, "");
}

// The bar slips out of the hand when the joint has come to `value`, on the second pull to twice
// that, `times` times.
void slip_at(TaskRun& run, double value, int times) {
  run.every_tick = [value, times](TaskRun& r) {
    const bool manipulating = r.out.phase == Phase::kManipulate;
    const bool slips = manipulating &&
                       r.plant.unit.joint.value > value * r.count(Phase::kManipulate) &&
                       r.count(Phase::kManipulate) <= times;
    r.plant.bar_there = !slips;
    EXPECT_TRUE(r.out.phase != Phase::kRetreat ||
                r.plant.opening_m > 0.8 * mabi()->config().gripper_opening_max_m);
  };
}

TEST(TaskGrasp, SlippedHandleIsReleasedAndGraspedOnceMore) {
  TaskRun run(drawer());
  run.plant.joint_speed_max =
      0.05;  // slips 4 s into the pull, which is longer than a release may take
  slip_at(run, 0.2, 1);
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.last(), Phase::kDone);
  EXPECT_EQ(run.count(Phase::kPreGrasp), 2);
  EXPECT_EQ(run.count(Phase::kGrasp), 2);
  EXPECT_EQ(run.count(Phase::kManipulate), 2);
  EXPECT_EQ(run.count(Phase::kRelease), 2);
  EXPECT_GT(run.plant.unit.joint.value, 0.36);
}

// Fingers that close on the very edge of the bar squeeze it out at once: the hand goes back to
// feeling where it is.
TEST(TaskGrasp, BarLostAsThePullBeginsIsProbedAndGraspedOnceMore) {
  TaskRun run(drawer());
  slip_at(run, -1.0, 1);
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.last(), Phase::kDone);
  EXPECT_EQ(run.count(Phase::kGrasp), 3);  // closed on the edge, probed, closed again
  EXPECT_EQ(run.count(Phase::kPreGrasp), 2);
  EXPECT_EQ(run.count(Phase::kManipulate), 2);
}

TEST(TaskGrasp, SecondSlipFails) {
  TaskRun run(drawer());
  slip_at(run, 0.1, 2);
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "grasp slipped");
  EXPECT_EQ(run.count(Phase::kGrasp), 2);
}

TEST(TaskGrasp, HandPulledOffThePathCountsAsSlipped) {
  TaskRun run(drawer());
  bool pushed = false;
  run.every_tick = [&](TaskRun& r) {
    r.plant.hand_follows = true;
    if (pushed || r.out.phase != Phase::kManipulate || r.plant.unit.joint.value < 0.1) return;
    pushed = true;
    const double yaw = kFarAway[2], aside = Limits().number("slip_m") + 0.01;
    r.plant.base[0] += -std::sin(yaw) * aside;  // across the drawer's path
    r.plant.base[1] += std::cos(yaw) * aside;
    r.plant.hand_follows = false;  // for this tick
  };
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.count(Phase::kGrasp), 2);
  EXPECT_EQ(run.last(), Phase::kDone);
}

TEST(TaskGrasp, MaskOfAHalfOpenObjectStaysWhereThePartIsWhenTheGraspIsMissed) {
  TaskRun run(drawer());
  run.plant.unit.joint.value = 0.2;
  run.plant.bar_there = false;
  run.every_tick = [](TaskRun& r) {
    if (r.out.phase != Phase::kRelease && r.out.phase != Phase::kRetreat) return;
    if (!r.reference.masks[1].active) return;
    const Unit& u = r.plant.unit;
    EXPECT_LE((r.reference.masks[1].X_WM.position() - u.moved(u.X_WM0).translation()).norm(), 1e-9);
  };
  ASSERT_NO_FATAL_FAILURE(run.run());
  expect_failed(run, "grasp missed");
}

TEST(TaskStuckJoint, IsReportedAndMeetsABoundedForce) {
  for (const Unit& unit : {drawer(), Unit::side_door(kFarAway)}) {
    TaskRun run(unit);
    run.plant.joint_moves = false;
    const bool prismatic = unit.joint.kind == JointKind::kPrismatic;
    const Limits limits;
    // Force on the handle: stiffness times the set-point's lead. The door's handle is 0.5 m from
    // its axis.
    const double lead_max =
        prismatic ? limits.number("lag_max_m") : 0.5 * limits.number("lag_max_rad");
    double most = 0;
    run.every_tick = [&](TaskRun& r) {
      if (r.out.phase != Phase::kManipulate || r.reference.ee[0].count < 3) return;
      const Eigen::Vector3d hand = hand_pose(r.plant.base, r.plant.q.data()).translation();
      most = std::max(most, (r.reference.ee[0].keyframes[0].X_WE.position() - hand).norm());
    };
    ASSERT_NO_FATAL_FAILURE(run.run());
    expect_failed(run, "object does not move");
    EXPECT_NEAR(run.lasted(Phase::kManipulate), limits.number("progress_timeout_s"), 2.5 * kTickS);
    EXPECT_EQ(run.count(Phase::kGrasp), 1) << "a second grasp would not help";
    EXPECT_LE(most, lead_max + 1e-3);
    EXPECT_GE(most, 0.9 * lead_max) << "or it never pulled";
  }
}

TEST(TaskAbort, DropsTheTaskAndLeavesTheGripperAlone) {
  TaskRun run(drawer());
  run.state.t_ns = run.t;
  run.plant.fill(run.state);
  run.sequencer.start(run.request, run.state);
  while (!run.out.held) ASSERT_NO_FATAL_FAILURE(run.step());
  const GripperCommand grip = run.out.gripper;
  run.sequencer.abort();
  EXPECT_FALSE(run.sequencer.busy());
  const TaskOutput out = run.sequencer.step({run.t, kTickS, &run.state, nullptr}, run.reference);
  EXPECT_EQ(out.phase, Phase::kNone);
  EXPECT_FALSE(out.held);
  EXPECT_EQ(out.gripper.opening_m, grip.opening_m);
  EXPECT_EQ(out.gripper.force_n, grip.force_n);
}

}  // namespace
}  // namespace wb
