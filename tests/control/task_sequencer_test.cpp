// TaskSequencer on the ideal plant: what a task does when all goes well.
#include "control/task_sequencer.hpp"

#include "core/rt/allocation_count.hpp"
#include "tests/control/task_fixture.hpp"

namespace wb {
namespace {

using namespace control_test;

const std::array<double, 3> kFarAway{3.0, 1.0, 0.5};

class TaskSequencerOpens : public testing::TestWithParam<int> {
 protected:
  static Unit unit() {
    return GetParam() == 0   ? Unit::drawer(0.4, kFarAway)
           : GetParam() == 1 ? Unit::side_door(kFarAway)
                             : Unit::oven(kFarAway);
  }
};
INSTANTIATE_TEST_SUITE_P(DrawerDoorOven, TaskSequencerOpens, testing::Values(0, 1, 2));

TEST_P(TaskSequencerOpens, RunsThroughAllPhasesToDone) {
  TaskRun run(unit());
  ASSERT_NO_FATAL_FAILURE(run.run());
  const std::vector<Phase> expected = {Phase::kApproach,   Phase::kPreGrasp, Phase::kGrasp,
                                       Phase::kManipulate, Phase::kRelease,  Phase::kRetreat,
                                       Phase::kDone};
  EXPECT_EQ(run.phases, expected);
  EXPECT_EQ(run.out.failure, "");
  const Limits limits;
  const ArticulationEstimate& joint = run.plant.unit.joint;
  const double lag =
      limits.number(joint.kind == JointKind::kPrismatic ? "lag_max_m" : "lag_max_rad");
  const double target = limits.number("opened_fraction") * joint.range;
  EXPECT_GE(joint.value, target - 0.2 * lag - 1e-6);
  EXPECT_LE(joint.value, target + 1e-3);
  // What the hand's pose showed in the last tick of the pull, which itself moved on by speed times
  // the tick.
  const double speed = limits.number(joint.kind == JointKind::kPrismatic ? "prismatic_speed_mps"
                                                                         : "revolute_speed_radps");
  EXPECT_NEAR(run.out.joint_value, joint.value, speed * kTickS + 1e-3);
  EXPECT_EQ(run.out.joint_range, joint.range);
}

TEST_P(TaskSequencerOpens, PullsAtItsConfiguredSpeedAlongTheFreeDirection) {
  TaskRun run(unit());
  const bool prismatic = run.plant.unit.joint.kind == JointKind::kPrismatic;
  const double speed = Limits().number(prismatic ? "prismatic_speed_mps" : "revolute_speed_radps");
  double before = -1;
  int moving = 0;
  run.every_tick = [&](TaskRun& r) {
    const double value = r.plant.unit.joint.value;
    if (r.out.phase == Phase::kManipulate && r.out.held) {
      if (before > 0.01) {
        // The set-point moves by speed times the tick; the chords between keyframes are shorter
        // than arcs by less than 1 %.
        EXPECT_LE(value - before, 1.01 * speed * kTickS);
        moving += value - before > 0.99 * speed * kTickS;
      }
      before = value;
      const Unit& u = r.plant.unit;
      const Eigen::Vector3d axis = Eigen::Vector3d::Map(u.joint.axis.data());
      const Eigen::Vector3d arm = hand_pose(r.plant.base, r.plant.q.data()).translation() -
                                  Eigen::Vector3d::Map(u.joint.axis_origin.data());
      const Eigen::Vector3d way = prismatic ? axis : Eigen::Vector3d(axis.cross(arm).normalized());
      // Half the spacing of the keyframes, 1.4 / 32 rad, is the angle between chord and tangent;
      // the step of 0.01 adds as much again.
      EXPECT_TRUE(before <= 0.01 || r.out.free_direction_W.dot(way) >= std::cos(0.04));
    }
  };
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_GT(moving, 50);
}

TEST_P(TaskSequencerOpens, MovingMaskGoesWithTheJointAndTheCarcassStays) {
  TaskRun run(unit());
  double largest = 0;
  run.every_tick = [&](TaskRun& r) {
    if (r.out.phase != Phase::kManipulate || !r.out.held) return;
    const Unit& u = r.plant.unit;
    const Eigen::Isometry3d expected = u.moved(u.X_WM0),
                            mask = r.reference.masks[1].X_WM.isometry();
    // The joint value is read from the hand, whose chords differ from the arc by 0.5 m (0.044
    // rad)^2 / 8.
    EXPECT_LE((mask.translation() - expected.translation()).norm(), 1e-3);
    EXPECT_TRUE(mask.linear().isApprox(expected.linear(), 2e-3));
    EXPECT_EQ(r.reference.masks[0].X_WM.p, Pose::from(u.X_WM0).p);
    largest = std::max(largest, (mask.translation() - u.X_WM0.translation()).norm());
  };
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_GT(largest, 0.25);
}

TEST_P(TaskSequencerOpens, SetPointLeadsTheHandByNoMoreThanTheLag) {
  TaskRun run(unit());
  const bool prismatic = run.plant.unit.joint.kind == JointKind::kPrismatic;
  run.plant.joint_speed_max = prismatic ? 0.08 : 0.2;  // slower than the set-point would go
  const double lag = Limits().number(prismatic ? "lag_max_m" : "lag_max_rad");
  double most = 0;
  run.every_tick = [&](TaskRun& r) {
    if (r.out.phase != Phase::kManipulate || r.reference.ee[0].count < 3) return;
    const ObjectPlan closed = [&] {
      Unit u = r.plant.unit;
      u.joint.value = 0;
      return u.plan(0, true);
    }();
    // Joint value of the first keyframe, by projection of its displacement.
    const Eigen::Vector3d axis = Eigen::Vector3d::Map(closed.articulation.axis.data());
    const Eigen::Vector3d hand = hand_pose(r.plant.base, r.plant.q.data()).translation();
    const Eigen::Vector3d lead = r.reference.ee[0].keyframes[0].X_WE.position() - hand;
    double value = axis.dot(lead);
    if (!prismatic) {
      const Eigen::Vector3d origin = Eigen::Vector3d::Map(closed.articulation.axis_origin.data());
      const Eigen::Vector3d a = hand - origin, b = a + lead;
      value = std::atan2(axis.dot(a.cross(b)), a.dot(b) - axis.dot(a) * axis.dot(b));
    }
    most = std::max(most, value);
  };
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_LE(most, lag + 1e-3);
  EXPECT_GE(most, 0.8 * lag) << "or the test says nothing";
}

TEST(TaskSequencer, ApproachAsksForTheBaseAndKeepsTheArmStowedUntilItIsNear) {
  TaskRun run(Unit::drawer(0.4, kFarAway));
  run.plant.base_moves = false;
  run.plant.hand_follows = false;
  run.state.t_ns = run.t;
  run.sequencer.start(run.request, run.state);
  ASSERT_NO_FATAL_FAILURE(run.step());
  EXPECT_TRUE(run.reference.base_goal_active);
  EXPECT_EQ(run.reference.ee[0].count, 0);
  const std::vector<double>& stowed = mabi()->config().stowed;
  EXPECT_TRUE(std::equal(stowed.begin(), stowed.end(), run.reference.posture.begin()));
  // The unit was placed in front of a base at kFarAway; the ready hand is level to within a few
  // degrees only.
  EXPECT_NEAR(run.reference.base_goal[0], kFarAway[0], 0.02);
  EXPECT_NEAR(run.reference.base_goal[1], kFarAway[1], 0.02);
  EXPECT_NEAR(run.reference.base_goal[2], kFarAway[2], 0.02);
  run.plant.base = run.reference.base_goal;
  run.plant.base[0] -= 0.5;
  ASSERT_NO_FATAL_FAILURE(run.step());
  const std::vector<double>& ready = mabi()->config().ready;
  EXPECT_TRUE(std::equal(ready.begin(), ready.end(), run.reference.posture.begin()));
}

TEST(TaskSequencer, PlansOfOtherObjectsAndOfEarlierRequestsAreIgnored) {
  for (const bool other : {true, false}) {
    TaskRun run(Unit::drawer(0.4, kFarAway));
    if (other) {
      run.request.object = Name("another");
    } else {
      run.request.t_ns = run.t + 1000 * kNanosPerSecond;
    }
    ASSERT_NO_FATAL_FAILURE(run.run());
    EXPECT_EQ(run.last(), Phase::kFailed);
    EXPECT_EQ(run.out.failure, "object not found");
    EXPECT_EQ(run.count(Phase::kPreGrasp), 0);
  }
}

TEST(TaskSequencer, MeasurementIsKeptWhenTheHandleLeavesTheView) {
  TaskRun run(Unit::drawer(0.4, kFarAway));
  Unit prior = run.plant.unit;
  int seen = 0;
  run.every_tick = [&](TaskRun& r) {
    if (r.out.phase != Phase::kPreGrasp) return;
    if (++seen == 3) {  // from now on only a coarse prior comes in, 5 cm off
      r.measures = false;
      r.plant.unit.X_WG0.translation().y() += 0.05;
    }
    if (seen > 4) {
      const Eigen::Vector3d p = r.reference.ee[0].keyframes[0].X_WE.position();
      EXPECT_NEAR(
          p.y(),
          (prior.X_WG0 * Eigen::Vector3d(0, 0, -Limits().number("pre_grasp_standoff_m"))).y(),
          1e-9);
    }
    if (seen == 10) r.plant.unit.X_WG0 = prior.X_WG0;  // where it really is
  };
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.last(), Phase::kDone);
}

TEST(TaskSequencer, OpenedFractionOfTheRequestIsHowFarItOpens) {
  TaskRun run(Unit::drawer(0.4, kFarAway));
  run.request.opened_fraction = 0.5;
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.last(), Phase::kDone);
  EXPECT_NEAR(run.plant.unit.joint.value, 0.2, 0.2 * Limits().number("lag_max_m") + 1e-6);
}

TEST(TaskSequencer, ObjectThatIsFullyOpenAlreadyIsDone) {
  for (const double beyond : {0.0, 0.001}) {  // a measured value may exceed the range a little
    TaskRun run(Unit::drawer(0.3, kFarAway));
    run.plant.unit.joint.value = 0.3 + beyond;
    ASSERT_NO_FATAL_FAILURE(run.run());
    EXPECT_EQ(run.last(), Phase::kDone);
    EXPECT_NEAR(run.plant.unit.joint.value, 0.3, 0.02);
  }
}

TEST(TaskSequencer, MoveJointsGoesThereAndKeepsTheBaseWhereItWas) {
  TaskRun run(Unit::drawer(0.4, kFarAway));
  run.request.kind = RequestKind::kMoveJoints;
  run.request.joint_count = 6;
  std::copy_n(mabi()->config().ready.begin(), 6, run.request.q.begin());
  run.plant.base = {1, 2, 0.3};
  run.plant.hand_follows = false;
  int ticks = 0;
  run.every_tick = [&](TaskRun& r) {
    ASSERT_EQ(r.reference.base_count, 1);
    EXPECT_EQ(r.reference.base[0].base, (std::array<double, 3>{1, 2, 0.3}));
    EXPECT_TRUE(
        std::equal(r.request.q.begin(), r.request.q.begin() + 6, r.reference.posture.begin()));
    r.plant.base[0] += 0.001;  // pushed about
    r.plant.hand_follows = ++ticks > 10;
  };
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.last(), Phase::kDone);
}

TEST(TaskSequencer, MoveBaseGoesThere) {
  TaskRun run(Unit::drawer(0.4, kFarAway));
  run.request.kind = RequestKind::kMoveBase;
  run.request.base = {1.5, -1.0, 3.0};
  ASSERT_NO_FATAL_FAILURE(run.run());
  EXPECT_EQ(run.last(), Phase::kDone);
  EXPECT_EQ(run.plant.base, run.request.base);
}

TEST(TaskSequencer, StepDoesNotAllocate) {
  for (const Unit& unit : {Unit::drawer(0.4, kFarAway), Unit::side_door(kFarAway)}) {
    TaskRun run(unit);
    std::uint64_t allocations = 0;
    run.state.t_ns = run.t;
    run.sequencer.start(run.request, run.state);
    while (!run.out.ended) {
      run.plant.fill(run.state);
      run.state.t_ns = run.t;
      const ObjectPlan plan = run.plant.unit.plan(run.t, run.out.phase == Phase::kPreGrasp);
      const std::uint64_t before = thread_allocations();
      run.out = run.sequencer.step({run.t, kTickS, &run.state, &plan}, run.reference);
      allocations += thread_allocations() - before;
      run.plant.step(run.reference, run.out.gripper, run.t, kTickS);
      run.t += from_seconds(kTickS);
    }
    EXPECT_EQ(run.out.phase, Phase::kDone);
    EXPECT_EQ(allocations, 0u);
  }
}

}  // namespace
}  // namespace wb
