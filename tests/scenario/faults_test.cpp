// Faults, each made to happen: what the plant, the controller and the operator's reset then do. By
// the simulator's truth.
#include <gtest/gtest.h>

#include <limits>

#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::Displacement;
using test::SimulatedRun;

// Of a robot that stands: what its servos and the contacts of its wheels may creep in a second.
constexpr double kStill_m = 0.002, kStill_rad = 0.002;

void expect_still(const SimulatedRun& run, const test::Posture& before) {
  const Displacement d = between(before, run.posture());
  EXPECT_LT(d.base_m, kStill_m);
  EXPECT_LT(d.base_rad, kStill_rad);
  EXPECT_LT(d.joint_rad, kStill_rad);
}

void expect_stands_still(SimulatedRun& run) {
  const test::Posture before = run.posture();
  run.run_for(1);
  expect_still(run, before);
}

// The operator's reset on the living plant: Ready again, and nothing has moved.
void expect_reset_moves_nothing(SimulatedRun& run) {
  const test::Posture before = run.posture();
  const std::uint64_t id = run.reset();
  run.run_for(1);
  EXPECT_EQ(run.outcome(id), RequestOutcome::kSucceeded) << run.status(id).reason.view();
  EXPECT_EQ(run.mode(), Mode::kReady);
  expect_still(run, before);
}

void expect_failed(const SimulatedRun& run, std::uint64_t id, std::string_view reason) {
  EXPECT_EQ(run.outcome(id), RequestOutcome::kFailed);
  EXPECT_EQ(run.status(id).reason.view(), reason);
}

// A run in which drawer_1 is in the hand and a third open.
class Pull : public ::testing::Test {
 protected:
  Pull() : run({.seed = 3000}) {
    run.reset();
    open = run.open("drawer_1");
    pulling =
        run.run_until([&] { return run.phase() == Phase::kManipulate && drawer_m() > 0.15; }, 60);
  }
  double drawer_m() const { return run.object("drawer_1").value; }
  // The bar is between the pads, which press on it.
  void expect_grasp_kept() {
    EXPECT_GT(run.system().state().gripper_opening_m, 0.008);  // the bar's diameter is 12 mm
    EXPECT_GT(run.system().state().gripper_force_n, 30.0);     // half of what the grasp asked for
    EXPECT_NEAR(drawer_m(), at_fault_m, 0.02);
  }
  const ControlCounters& counters() { return run.system().control_counters(); }

  SimulatedRun run;
  std::uint64_t open = 0;
  bool pulling = false;
  double at_fault_m = 0;
};

TEST(ControlThatHangs, IsStoppedByTheDriversTimeOutAndResetMovesNothing) {
  SimulatedRun run({.spawn = "{x_m: -2.6, y_m: -1.4, yaw_rad: 0}"});
  run.reset();
  const std::uint64_t id = run.move_base({2.6, 0, 0});
  ASSERT_TRUE(run.run_until([&] { return run.system().state().base_velocity[0] > 0.8; }, 10));
  const double speed = run.system().state().base_velocity[0];
  const test::Posture before = run.posture();
  run.hang("control");
  double farthest_m = 0, arm_rad = 0;
  for (int i = 0; i < 100; ++i) {
    run.run_for(0.01);
    const Displacement d = between(before, run.posture());
    farthest_m = std::max(farthest_m, d.base_m);
    arm_rad = std::max(arm_rad, d.joint_rad);
  }
  // On at speed until the time-out (and a tick), then by the brakes. The wheels slide, and their
  // load goes to the castors 0.2 m ahead of the axle, on which they do not brake: mu g (l + c) / (l
  // + h), centre of mass c = 0.04 m behind the axle, h = 0.33 m high.
  const double deceleration = 9.81 * (0.2 + 0.04) / (0.2 + 0.33);
  const double bound_m = speed * (0.050 + 0.005) + speed * speed / (2 * deceleration);
  RecordProperty("speed_mmps", static_cast<int>(1e3 * speed));
  RecordProperty("farthest_mm", static_cast<int>(1e3 * farthest_m));
  EXPECT_LT(farthest_m, 1.1 * bound_m);
  // The arm gives way while the base brakes, 28 kg half a metre from SH_FLE's 3000 Nm/rad, doubled
  // as it comes at once; and comes back.
  EXPECT_LT(arm_rad, 2 * 28 * 0.5 * deceleration / 3000);
  EXPECT_LT(between(before, run.posture()).joint_rad, 0.01);
  expect_stands_still(run);

  run.hang("control", false);
  run.run_for(0.1);
  EXPECT_EQ(run.mode(), Mode::kSettle);
  EXPECT_GT(run.system().control_counters().driver_faults, 0u);
  expect_failed(run, id, "driver fault");
  expect_reset_moves_nothing(run);
  EXPECT_EQ(run.contacts(), 0u) << run.contact_names();
}

TEST_F(Pull, PluginThatStopsAnsweringHaltsThePlant) {
  ASSERT_TRUE(pulling);
  at_fault_m = drawer_m();
  run.fault().stop_answering(run.driver(), 1);
  run.run_for(0.5);
  EXPECT_EQ(run.mode(), Mode::kSettle);
  EXPECT_GT(counters().driver_faults, 0u);
  expect_failed(run, open, "driver fault");
  expect_stands_still(run);

  const std::uint64_t refused = run.reset();
  run.run_for(0.01);
  EXPECT_EQ(run.outcome(refused), RequestOutcome::kRefused);
  run.fault().stop_answering(run.driver(), 0);
  run.run_for(0.1);
  EXPECT_EQ(run.mode(), Mode::kSettle) << "only a reset leads out";
  expect_reset_moves_nothing(run);
  expect_grasp_kept();
}

TEST_F(Pull, HungBusSettlesBecauseItsReadingsGrowOld) {
  ASSERT_TRUE(pulling);
  at_fault_m = drawer_m();
  run.fault().freeze(run.driver(), 1);
  run.run_for(0.5);
  EXPECT_EQ(run.mode(), Mode::kSettle);
  EXPECT_GT(counters().invalid_readings, 0u);
  expect_failed(run, open, "joint readings missing");
  expect_stands_still(run);
  run.fault().freeze(run.driver(), 0);
  run.run_for(0.1);
  expect_reset_moves_nothing(run);
  expect_grasp_kept();
}

TEST_F(Pull, EmergencyStopSettlesAndIsNotResetWhilePressed) {
  ASSERT_TRUE(pulling);
  at_fault_m = drawer_m();
  run.fault().emergency_stop(run.driver(), 1);
  run.run_for(0.5);
  EXPECT_EQ(run.mode(), Mode::kSettle);
  EXPECT_GT(counters().emergency_stops, 0u);
  expect_failed(run, open, "emergency stop");
  expect_stands_still(run);
  const std::uint64_t refused = run.reset();
  run.run_for(0.01);
  EXPECT_EQ(run.outcome(refused), RequestOutcome::kRefused);
  EXPECT_EQ(run.mode(), Mode::kSettle);
  run.fault().emergency_stop(run.driver(), 0);
  run.run_for(0.1);
  expect_reset_moves_nothing(run);
  expect_grasp_kept();
}

TEST_F(Pull, MpcThatStopsDeliveringMeansHoldAndTheGraspIsKept) {
  ASSERT_TRUE(pulling);
  run.hang("mpc");
  ASSERT_TRUE(run.run_until([&] { return run.mode() == Mode::kHold; }, 0.5));
  EXPECT_GT(counters().stale_policies, 0u);
  expect_failed(run, open, "policy too old");
  run.run_for(0.5);
  at_fault_m = drawer_m();
  expect_stands_still(run);
  expect_grasp_kept();
  run.hang("mpc", false);
  run.run_for(0.1);
  EXPECT_EQ(run.mode(), Mode::kHold) << "only a reset leads out";
  expect_reset_moves_nothing(run);
  expect_grasp_kept();
}

// What a mapper gone wrong would hand over in place of a map.
void publish_field_without_numbers(SimulatedRun& run) {
  auto& arrow = run.system().arrows().field;
  DistanceField& field = arrow.writing();
  const std::array<int, 3>& n = field.size();
  std::fill_n(field.data(), n[0] * n[1] * n[2], std::numeric_limits<float>::quiet_NaN());
  arrow.publish();
}

TEST_F(Pull, MapWithoutNumbersDegradesThePullWhichEndsWithASoundOne) {
  ASSERT_TRUE(pulling);
  run.hang("mapping");
  publish_field_without_numbers(run);
  ASSERT_TRUE(run.run_until([&] { return run.mode() == Mode::kDegraded; }, 0.2));
  EXPECT_EQ(run.system().mpc_record().report.status, SolveStatus::kNotFinite);
  EXPECT_EQ(describe(run.system().problem(), run.system().mpc_record().report.trouble),
            "term environment is not a number at node 0 (0.00 s)");
  run.hang("mapping", false);
  ASSERT_TRUE(run.run_until([&] { return run.ended(open); }, 30));
  EXPECT_EQ(run.outcome(open), RequestOutcome::kSucceeded) << run.status(open).reason.view();
  EXPECT_EQ(run.mode(), Mode::kDegraded) << "only a reset leads out";
  EXPECT_GT(drawer_m(), 0.4);
  EXPECT_EQ(run.contacts(), 0u) << run.contact_names();
  expect_reset_moves_nothing(run);
}

TEST_F(Pull, MapWithoutNumbersForTooLongMeansHoldAndTheGraspIsKept) {
  ASSERT_TRUE(pulling);
  run.hang("mapping");
  publish_field_without_numbers(run);
  ASSERT_TRUE(run.run_until([&] { return run.mode() == Mode::kHold; }, 1));
  expect_failed(run, open, "no policy of full quality");
  run.run_for(0.5);
  at_fault_m = drawer_m();
  expect_stands_still(run);
  expect_grasp_kept();
}

// The MPC keeps the last field: what it shows is avoided as before, what comes later is not seen.
TEST(MappingThatHangs, LeavesTheMpcTheLastField) {
  SimulatedRun run({.seed = 3000});
  run.reset();
  const std::uint64_t id = run.open("drawer_1");
  run.run_for(2);
  run.hang("mapping");
  run.run_for(0.2);
  const std::uint64_t field = run.system().mpc_record().field_seq;
  EXPECT_GT(field, 0u);
  while (!run.ended(id) && run.now() < 60 * kNanosPerSecond) {
    run.run_for(0.1);
    EXPECT_EQ(run.system().mpc_record().field_seq, field);
  }
  EXPECT_TRUE(run.ended(id));
  EXPECT_EQ(run.system().control_counters().stale_policies, 0u);
}

}  // namespace
}  // namespace wb
