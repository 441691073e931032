// Controller: requests and their refusals, the ladder of modes, counters, and that equal inputs
// give equal bits.
#include "control/controller.hpp"

#include <gtest/gtest.h>

#include "core/rt/allocation_count.hpp"
#include "core/types/hash.hpp"
#include "tests/control/ideal_plant.hpp"

namespace wb {
namespace {

using namespace control_test;

constexpr double kPolicyMemoryS = 0.25, kReadingMemoryS = 0.02,
                 kDegradedMemoryS = 0.5;  // control.yaml

struct Rig {
  Rig() {
    plant.base_moves = false;  // the unit is within the arm's reach from where the base starts
    policy.nodes = 2;
    policy.states = mabi()->nx();
    policy.inputs = mabi()->nu();
    out.state = &state;
    out.reference = &reference;
  }

  Controller controller{mabi()};
  IdealPlant plant{Unit::drawer(0.2, kAtOrigin)};
  Readings readings;
  RobotState state;
  Reference reference;
  ControlOutput out;
  Policy policy;
  bool policy_flows = true, plant_runs = true;
  TimeNs t = kNanosPerSecond;
  StateHash hash;
  std::vector<Request> pending;
  std::vector<RequestStatus> statuses;  // all so far
  std::uint64_t next_id = 1, allocations = 0;
  std::function<void(Readings&)> disturb;  // spoils what was read

  std::uint64_t ask(RequestKind kind) {
    Request r;
    r.kind = kind;
    r.object = Name("unit");
    return ask(r);
  }
  std::uint64_t ask(Request r) {
    r.id = next_id++;
    pending.push_back(r);
    return r.id;
  }

  void step() {
    t += kPeriodNs;
    plant.fill(readings);
    readings.t_ns = t;
    readings.emergency_stop = readings.driver_fault = false;
    if (disturb) disturb(readings);
    for (Request& r : pending) r.t_ns = t;
    if (policy_flows) {
      policy.t_ns = policy.t[0] = t;
      policy.t[1] = t + kNanosPerSecond;
    }
    const ObjectPlan plan = plant.unit.plan(t, state.phase == Phase::kPreGrasp);
    const std::uint64_t before = thread_allocations();
    controller.step(
        {t, &readings, &policy, &plan, pending.data(), static_cast<int>(pending.size())}, out);
    allocations += thread_allocations() - before;
    pending.clear();
    hash.add(state);
    hash.add(out.command);
    for (int i = 0; i < out.status_count; ++i) statuses.push_back(out.statuses[i]);
    if (plant_runs && task_runs(state.mode, state.phase))
      plant.step(reference, out.command.get().gripper, t, kDt);
  }
  void run(double seconds) {
    for (int i = 0; i < seconds / kDt; ++i) step();
  }
  void run_until(Phase phase) {
    for (int i = 0; i < 8000 && state.phase != phase; ++i) step();
    ASSERT_EQ(state.phase, phase);
  }
  // What was last said of a request.
  RequestStatus status(std::uint64_t id) const {
    for (auto s = statuses.rbegin(); s != statuses.rend(); ++s) {
      if (s->id == id) return *s;
    }
    ADD_FAILURE() << "no status of request " << id;
    return {};
  }
  void expect(std::uint64_t id, RequestOutcome outcome, std::string_view reason) const {
    EXPECT_EQ(status(id).outcome, outcome);
    EXPECT_EQ(status(id).reason.view(), reason);
  }
  void get_ready() {
    ask(RequestKind::kReset);
    step();
    ASSERT_EQ(state.mode, Mode::kReady);
  }
};

void expect_still(const Command& c) {
  for (int i = 0; i < c.joint_count; ++i) EXPECT_EQ(c.joints[i].velocity, 0.0);
  for (int i = 0; i < c.wheel_count; ++i) EXPECT_EQ(c.wheels[i].velocity, 0.0);
}

TEST(Controller, IdleMovesNothingUntilItIsReset) {
  Rig rig;
  rig.run(0.1);
  EXPECT_EQ(rig.state.mode, Mode::kIdle);
  EXPECT_EQ(rig.out.command.get().joint_count, 0);
  EXPECT_FALSE(rig.out.activate_drives);
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.step();
  rig.expect(open, RequestOutcome::kRefused, "not ready: reset first");
  EXPECT_EQ(rig.state.mode, Mode::kIdle);
}

TEST(Controller, ResetActivatesTheDrivesAndMovesNothing) {
  Rig rig;
  const std::uint64_t reset = rig.ask(RequestKind::kReset);
  rig.step();
  rig.expect(reset, RequestOutcome::kSucceeded, "");
  EXPECT_TRUE(rig.out.activate_drives);
  EXPECT_EQ(rig.state.mode, Mode::kReady);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(rig.out.command.get().joints[i].position, rig.plant.q[i]);
  expect_still(rig.out.command.get());
  rig.step();
  EXPECT_FALSE(rig.out.activate_drives) << "in the tick of the reset only";
  for (int i = 0; i < 6; ++i) EXPECT_EQ(rig.out.command.get().joints[i].position, rig.plant.q[i]);
}

TEST(Controller, RefusesWithAReason) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  Request wrong_size, out_of_range, not_a_number;
  wrong_size.kind = out_of_range.kind = not_a_number.kind = RequestKind::kMoveJoints;
  wrong_size.joint_count = 5;
  out_of_range.joint_count = not_a_number.joint_count = 6;
  out_of_range.q[1] = 1.0;  // SH_FLE: -pi to 0
  not_a_number.q[0] = std::nan("");
  const std::uint64_t a = rig.ask(wrong_size), b = rig.ask(out_of_range), c = rig.ask(not_a_number);
  const std::uint64_t d = rig.ask(RequestKind::kNone);
  rig.step();
  rig.expect(a, RequestOutcome::kRefused, "wrong number of joints");
  rig.expect(b, RequestOutcome::kRefused, "out of joint range");
  rig.expect(c, RequestOutcome::kRefused, "out of joint range");
  rig.expect(d, RequestOutcome::kRefused, "unknown request");
  EXPECT_EQ(rig.state.mode, Mode::kReady);

  const std::uint64_t first = rig.ask(RequestKind::kOpen), second = rig.ask(RequestKind::kOpen);
  rig.step();
  EXPECT_EQ(rig.out.statuses[0].id, first);
  EXPECT_EQ(rig.out.statuses[0].outcome, RequestOutcome::kAccepted);
  rig.expect(second, RequestOutcome::kRefused, "busy");
  const std::uint64_t reset = rig.ask(RequestKind::kReset);
  rig.step();
  rig.expect(reset, RequestOutcome::kRefused, "busy: stop first");
  EXPECT_EQ(rig.state.mode, Mode::kActive);
  EXPECT_EQ(rig.controller.counters().refused_requests, 6u);
}

TEST(Controller, OpensAnObjectAndSaysSo) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.run(10.0);
  const RequestStatus s = rig.status(open);
  EXPECT_EQ(s.outcome, RequestOutcome::kSucceeded);
  EXPECT_EQ(s.phase, Phase::kDone);
  EXPECT_NEAR(s.joint_value, rig.plant.unit.joint.value, 1e-3);
  EXPECT_EQ(rig.state.mode, Mode::kReady);
  EXPECT_TRUE(rig.out.hand_empty);
  int running = 0;
  for (const RequestStatus& r : rig.statuses) running += r.outcome == RequestOutcome::kRunning;
  EXPECT_GT(running, 10) << "ten times a second";
  expect_still(rig.out.command.get());
}

TEST(Controller, StopEndsTheTaskAndStandsStill) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.policy.u(0).setConstant(0.3);
  rig.run(0.5);
  const std::uint64_t stop = rig.ask(RequestKind::kStop);
  rig.step();
  rig.expect(open, RequestOutcome::kFailed, "stopped");
  rig.expect(stop, RequestOutcome::kSucceeded, "");
  EXPECT_EQ(rig.state.mode, Mode::kReady);
  rig.run(1.0);  // the longest stop within the acceleration limits takes 0.33 s
  expect_still(rig.out.command.get());
  const std::uint64_t again = rig.ask(RequestKind::kStop);
  rig.step();
  rig.expect(again, RequestOutcome::kSucceeded, "");
}

TEST(Controller, FollowsThePolicyOnlyWhileATaskRuns) {
  Rig rig;
  rig.policy.u(0).setConstant(0.1);
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  rig.run(0.1);
  expect_still(rig.out.command.get());
  rig.ask(RequestKind::kOpen);
  rig.run(0.5);
  // 0.1 rad/s and 0.1 m/s are within all limits and reached after 0.1 s.
  EXPECT_NEAR(rig.out.command.get().joints[0].velocity, 0.1, 1e-9);
  EXPECT_GT(rig.out.command.get().wheels[1].velocity, 0.5);
}

TEST(Controller, PolicyOfAnEarlierTaskIsNotFollowed) {
  Rig rig;
  rig.policy.u(0).setConstant(0.1);
  rig.policy.t_ns = rig.policy.t[0] = rig.t;
  rig.policy.t[1] = rig.t + 100 * kNanosPerSecond;
  rig.policy_flows = false;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  rig.ask(RequestKind::kOpen);
  rig.run(0.2);
  EXPECT_EQ(rig.state.mode, Mode::kActive) << "the first policy may take a moment";
  expect_still(rig.out.command.get());
}

TEST(Controller, StalePolicyHoldsAndKeepsTheGrasp) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  ASSERT_NO_FATAL_FAILURE(rig.run_until(Phase::kManipulate));
  rig.run(0.1);
  const GripperCommand grip = rig.out.command.get().gripper;
  ASSERT_EQ(grip.opening_m, 0.0);
  ASSERT_GT(grip.force_n, 0.0);
  rig.policy_flows = false;
  rig.run(kPolicyMemoryS - kDt);
  EXPECT_EQ(rig.state.mode, Mode::kActive);
  rig.run(3 * kDt);
  EXPECT_EQ(rig.state.mode, Mode::kHold);
  rig.expect(open, RequestOutcome::kFailed, "policy too old");
  EXPECT_EQ(rig.controller.counters().stale_policies, 1u) << "counted once: in HOLD none is needed";
  rig.run(1.0);
  EXPECT_EQ(rig.out.command.get().gripper.opening_m, grip.opening_m);
  EXPECT_EQ(rig.out.command.get().gripper.force_n, grip.force_n);
  EXPECT_FALSE(rig.out.hand_empty);
  expect_still(rig.out.command.get());
  rig.policy_flows = true;
  rig.run(0.5);
  EXPECT_EQ(rig.state.mode, Mode::kHold) << "leaving takes a reset";
  const std::uint64_t refused = rig.ask(RequestKind::kOpen);
  rig.step();
  rig.expect(refused, RequestOutcome::kRefused, "not ready: reset first");
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  EXPECT_EQ(rig.out.command.get().gripper.force_n, grip.force_n)
      << "a reset does not let go either";
}

void degrade(Rig& rig) {
  rig.policy.quality = PolicyQuality::kKept;
  rig.run(2 * kDt);
  rig.policy.quality = PolicyQuality::kFull;
  ASSERT_EQ(rig.state.mode, Mode::kDegraded);
}

TEST(Degraded, TakesTwoPoliciesInARowThatAreNotOfFullQuality) {
  for (const PolicyQuality bad : {PolicyQuality::kKept, PolicyQuality::kShortened}) {
    Rig rig;
    ASSERT_NO_FATAL_FAILURE(rig.get_ready());
    rig.ask(RequestKind::kOpen);
    rig.run(0.1);
    for (int i = 0; i < 3; ++i) {  // one alone is none
      rig.policy.quality = bad;
      rig.step();
      rig.policy.quality = PolicyQuality::kFull;
      rig.step();
    }
    rig.policy.quality = bad;
    rig.step();
    rig.policy_flows = false;
    rig.run(0.1);  // the same policy again is not a second one
    EXPECT_EQ(rig.state.mode, Mode::kActive);
    EXPECT_EQ(rig.controller.counters().degraded_policies, 4u);
    rig.policy_flows = true;
    rig.step();
    EXPECT_EQ(rig.state.mode, Mode::kDegraded);
    EXPECT_EQ(rig.controller.counters().degraded_policies, 5u);
  }
}

TEST(Degraded, OpensTheObjectSlowlyAndThenTakesAReset) {
  const auto seconds = [](bool degraded) {
    Rig rig;
    rig.get_ready();
    const std::uint64_t open = rig.ask(RequestKind::kOpen);
    rig.run_until(Phase::kManipulate);
    if (degraded) degrade(rig);
    const TimeNs from = rig.t;
    double fastest = 0, last = rig.plant.unit.joint.value;
    while (rig.state.phase == Phase::kManipulate && rig.t < from + 20 * kNanosPerSecond) {
      rig.step();
      fastest = std::max(fastest, (rig.plant.unit.joint.value - last) / kDt);
      last = rig.plant.unit.joint.value;
    }
    // control.yaml: the set-point's speed along a drawer is 0.15 m/s.
    EXPECT_NEAR(fastest, degraded ? 0.075 : 0.15, 1e-3);
    const double pull_s = to_seconds(rig.t - from);
    rig.run(10.0);
    rig.expect(open, RequestOutcome::kSucceeded, "");
    EXPECT_EQ(rig.state.mode, degraded ? Mode::kDegraded : Mode::kReady);
    EXPECT_EQ(rig.state.phase, Phase::kNone);
    expect_still(rig.out.command.get());
    if (degraded) {
      const std::uint64_t refused = rig.ask(RequestKind::kOpen);
      rig.step();
      rig.expect(refused, RequestOutcome::kRefused, "not ready: reset first");
      rig.get_ready();
    }
    return pull_s;
  };
  const double fast = seconds(false), slow = seconds(true);
  EXPECT_NEAR(slow, 2 * fast, 0.02 * fast);
}

TEST(Degraded, HalvesTheReferencesSpeedAndMovesNoKeyframe) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  rig.ask(RequestKind::kOpen);
  ASSERT_NO_FATAL_FAILURE(rig.run_until(Phase::kGrasp));
  rig.run(0.2);
  ASSERT_EQ(rig.reference.speed_scale, 1.0);
  Eigen::Vector3d last = IdealPlant::sample(rig.reference, rig.t).translation();
  rig.policy.quality = PolicyQuality::kKept;
  for (int i = 0; i < 40; ++i) {
    rig.step();
    const Eigen::Vector3d now = IdealPlant::sample(rig.reference, rig.t).translation();
    // control.yaml: the hand goes to the bar at 0.12 m/s.
    EXPECT_NEAR((now - last).norm() / kDt, i < 2 ? 0.12 : 0.06, 1e-6) << i;
    last = now;
  }
  ASSERT_EQ(rig.state.mode, Mode::kDegraded);
  EXPECT_EQ(rig.reference.speed_scale, 0.5);
}

TEST(Degraded, HalvesTheRatesOfAKeptPolicyAlongTheirPathWithoutAJump) {
  Rig rig;
  rig.plant_runs = false;
  rig.policy.u(0).setConstant(0.1);
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  rig.ask(RequestKind::kOpen);
  rig.run(0.5);
  Command last = rig.out.command.get();
  ASSERT_NEAR(last.joints[0].velocity, 0.1, 1e-9);
  rig.policy.quality = PolicyQuality::kKept;
  for (int i = 0; i < 100; ++i) {
    rig.step();
    const Command& c = rig.out.command.get();
    for (int j = 0; j < c.joint_count; ++j) {
      EXPECT_NEAR(c.joints[j].velocity, c.joints[0].velocity, 1e-9) << "one path";
      EXPECT_LE(std::abs(c.joints[j].velocity - last.joints[j].velocity),
                mabi()->limits(j).acceleration * kDt + 1e-9);
    }
    last = c;
  }
  EXPECT_NEAR(last.joints[0].velocity, 0.05, 1e-9);
  rig.policy.quality = PolicyQuality::kFull;  // the MPC plans it slowly itself
  rig.run(0.5);
  EXPECT_NEAR(rig.out.command.get().joints[0].velocity, 0.1, 1e-9);
}

TEST(Degraded, WithoutAFullPolicyForTooLongHoldsAndFailsTheRequest) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.run(0.5);
  rig.policy.quality = PolicyQuality::kKept;
  rig.run(kDegradedMemoryS - kDt);
  EXPECT_EQ(rig.state.mode, Mode::kDegraded);
  EXPECT_EQ(rig.status(open).outcome, RequestOutcome::kRunning);
  rig.run(3 * kDt);
  EXPECT_EQ(rig.state.mode, Mode::kHold);
  rig.expect(open, RequestOutcome::kFailed, "no policy of full quality");
  rig.policy.quality = PolicyQuality::kFull;
  rig.run(0.5);
  EXPECT_EQ(rig.state.mode, Mode::kHold);
  expect_still(rig.out.command.get());
}

TEST(Degraded, StillNeedsYoungPolicies) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.run(0.1);
  ASSERT_NO_FATAL_FAILURE(degrade(rig));
  rig.step();
  rig.policy_flows = false;
  rig.run(kPolicyMemoryS + 3 * kDt);
  EXPECT_EQ(rig.state.mode, Mode::kHold);
  rig.expect(open, RequestOutcome::kFailed, "policy too old");
}

TEST(Degraded, StopEndsTheTaskAndLeavesTheModeToTheReset) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.run(0.1);
  ASSERT_NO_FATAL_FAILURE(degrade(rig));
  const std::uint64_t reset = rig.ask(RequestKind::kReset);
  rig.step();
  rig.expect(reset, RequestOutcome::kRefused, "busy: stop first");
  rig.ask(RequestKind::kStop);
  rig.step();
  rig.expect(open, RequestOutcome::kFailed, "stopped");
  EXPECT_EQ(rig.state.mode, Mode::kDegraded);
  EXPECT_EQ(rig.state.phase, Phase::kNone);
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
}

struct Fault {
  const char* name;
  const char* reason;
  void (*disturb)(Readings&);
  std::uint64_t ControlCounters::*counter;
};
void PrintTo(const Fault& f, std::ostream* os) { *os << f.name; }

class ControllerFault : public testing::TestWithParam<Fault> {};
INSTANTIATE_TEST_SUITE_P(
    All, ControllerFault,
    testing::Values(
        Fault{"EmergencyStop", "emergency stop", [](Readings& r) { r.emergency_stop = true; },
              &ControlCounters::emergency_stops},
        Fault{"DriverFault", "driver fault", [](Readings& r) { r.driver_fault = true; },
              &ControlCounters::driver_faults},
        Fault{"InvalidJoint", "joint readings missing",
              [](Readings& r) { r.joints[3].valid = false; }, &ControlCounters::invalid_readings},
        Fault{"OldJoint", "joint readings missing",
              [](Readings& r) { r.joints[3].age_ns = from_seconds(kReadingMemoryS) + 1; },
              &ControlCounters::invalid_readings},
        Fault{"JointIsNoNumber", "joint readings missing",
              [](Readings& r) { r.joints[3].position = std::nan(""); },
              &ControlCounters::invalid_readings},
        Fault{"MissingJoint", "joint readings missing", [](Readings& r) { r.joint_count = 5; },
              &ControlCounters::invalid_readings},
        Fault{"InvalidWheel", "joint readings missing",
              [](Readings& r) { r.wheels[0].valid = false; }, &ControlCounters::invalid_readings}),
    [](const auto& info) { return info.param.name; });

TEST_P(ControllerFault, SettlesIsCountedAndTakesAResetToLeave) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.policy.u(0).setConstant(0.3);
  rig.plant_runs = false;
  rig.run(0.5);
  ASSERT_NE(rig.out.command.get().wheels[1].velocity, 0.0);
  rig.disturb = GetParam().disturb;
  rig.step();
  EXPECT_EQ(rig.state.mode, Mode::kSettle);
  rig.expect(open, RequestOutcome::kFailed, GetParam().reason);
  EXPECT_EQ(rig.controller.counters().*GetParam().counter, 1u);
  for (const JointCommand& w : rig.out.command.get().wheels)
    EXPECT_EQ(w.velocity, 0.0) << "brakes at once";
  rig.run(1.0);
  expect_still(rig.out.command.get());
  for (int i = 0; i < 6; ++i) EXPECT_TRUE(std::isfinite(rig.out.command.get().joints[i].torque));
  rig.disturb = nullptr;
  rig.run(0.1);
  EXPECT_EQ(rig.state.mode, Mode::kSettle) << "stays, though the fault has gone";

  // The set-points are somewhere else by now; a reset takes them to where the joints are.
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  EXPECT_TRUE(rig.out.activate_drives);
  for (int i = 0; i < 6; ++i) EXPECT_EQ(rig.out.command.get().joints[i].position, rig.plant.q[i]);
  expect_still(rig.out.command.get());
}

TEST_P(ControllerFault, InHoldGoesOnToSettle) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  rig.ask(RequestKind::kOpen);
  rig.policy_flows = false;
  rig.run(2 * kPolicyMemoryS);
  ASSERT_EQ(rig.state.mode, Mode::kHold);
  rig.disturb = GetParam().disturb;
  rig.step();
  EXPECT_EQ(rig.state.mode, Mode::kSettle);
}

TEST_P(ControllerFault, InDegradedGoesOnToSettle) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.run(0.1);
  ASSERT_NO_FATAL_FAILURE(degrade(rig));
  rig.disturb = GetParam().disturb;
  rig.step();
  EXPECT_EQ(rig.state.mode, Mode::kSettle);
  rig.expect(open, RequestOutcome::kFailed, GetParam().reason);
}

TEST_P(ControllerFault, InTheTickOfTheRequestFailsIt) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  const std::uint64_t open = rig.ask(RequestKind::kOpen);
  rig.disturb = GetParam().disturb;
  rig.step();
  EXPECT_EQ(rig.state.mode, Mode::kSettle);
  rig.expect(open, RequestOutcome::kFailed, GetParam().reason);
}

TEST(Controller, ResetIsRefusedWhileItsStartIsNotMeasuredOrTheButtonIsPressed) {
  const double nan = std::nan("");
  Rig rig;
  rig.step();
  rig.disturb = [&](Readings& r) { r.joints[0].position = nan; };
  std::uint64_t reset = rig.ask(RequestKind::kReset);
  rig.step();
  rig.expect(reset, RequestOutcome::kRefused, "joint readings missing");
  EXPECT_FALSE(rig.out.activate_drives);
  rig.disturb = [](Readings& r) { r.emergency_stop = true; };
  reset = rig.ask(RequestKind::kReset);
  rig.step();
  rig.expect(reset, RequestOutcome::kRefused, "emergency stop pressed");
  EXPECT_EQ(rig.state.mode, Mode::kIdle);
  // A driver that has timed out says so until it is activated again, which the reset is for.
  rig.disturb = [](Readings& r) { r.driver_fault = true; };
  reset = rig.ask(RequestKind::kReset);
  rig.step();
  rig.expect(reset, RequestOutcome::kSucceeded, "");
  rig.disturb = nullptr;
  rig.run(0.1);
  EXPECT_EQ(rig.state.mode, Mode::kReady);
}

TEST(Controller, PolicyOfNoNumbersIsRefusedByTheGateAndCounted) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  rig.ask(RequestKind::kOpen);
  rig.policy.u(0).setConstant(std::nan(""));
  rig.run(0.1);
  EXPECT_EQ(rig.out.command.reason(), GateReason::kNotFinite);
  expect_still(rig.out.command.get());
  EXPECT_GE(rig.controller.counters().refused_commands, 30u);
  EXPECT_EQ(rig.controller.counters().scaled_commands, 0u);
}

TEST(Controller, ScaledCommandsAreCounted) {
  Rig rig;
  ASSERT_NO_FATAL_FAILURE(rig.get_ready());
  rig.ask(RequestKind::kOpen);
  rig.policy.u(0).setConstant(50.0);
  rig.run(0.1);
  EXPECT_GE(rig.controller.counters().scaled_commands, 30u);
  EXPECT_EQ(rig.controller.counters().refused_commands, 0u);
}

TEST(Controller, EqualInputsGiveEqualBits) {
  const auto run = [](double u) {
    Rig rig;
    rig.ask(RequestKind::kReset);
    rig.step();
    rig.ask(RequestKind::kOpen);
    rig.policy.u(0).setConstant(u);
    rig.run(8.0);
    return rig.hash.value();
  };
  EXPECT_EQ(run(0.01), run(0.01));
  EXPECT_NE(run(0.01), run(0.0100001)) << "or the hash sees nothing";
}

TEST(Controller, StepDoesNotAllocate) {
  if (!allocations_are_counted()) GTEST_SKIP() << "a sanitizer owns malloc";
  Rig rig;
  rig.ask(RequestKind::kReset);
  rig.step();
  rig.ask(RequestKind::kOpen);
  rig.policy.u(0).setConstant(0.01);
  rig.run(8.0);
  rig.disturb = [](Readings& r) { r.emergency_stop = true; };
  rig.run(0.1);
  EXPECT_EQ(rig.allocations, 0u);
}

}  // namespace
}  // namespace wb
