// CommandGate: whatever is asked of it, what comes out is finite, inside the limits and continuous.
#include "control/command_gate.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "control/whole_body_controller.hpp"
#include "core/rt/allocation_count.hpp"
#include "tests/control/robot.hpp"

namespace wb {
namespace {

using control_test::kDt;
using control_test::kPeriodNs;
using control_test::mabi;

// Only CommandGate can fill a SafeCommand.
template <class T>
concept HasOpenCommand = requires(T t) {
  t.command_ = Command{};
};
template <class T>
concept HasOpenReason = requires(T t) {
  t.reason_ = GateReason::kNone;
};
static_assert(!HasOpenCommand<SafeCommand> && !HasOpenReason<SafeCommand>);
static_assert(!std::is_aggregate_v<SafeCommand>);
static_assert(!std::is_constructible_v<SafeCommand, Command>);
static_assert(!std::is_constructible_v<SafeCommand, Command, GateReason>);
static_assert(std::is_same_v<decltype(std::declval<SafeCommand&>().get()), const Command&>);
static_assert(std::is_same_v<decltype(std::declval<SafeCommand&>().reason()), GateReason>);

// Rounding of positions up to 6 rad shows in differences: 2 eps 6 / dt, and once more divided by
// dt.
constexpr double kVelocityRounding = 2e-12;     // rad/s
constexpr double kAccelerationRounding = 2e-9;  // rad/s^2

Command still_request(const CommandGate& gate, TimeNs now) {
  Command c;
  c.t_ns = now;
  c.joint_count = mabi()->joints();
  c.wheel_count = 2;
  for (int i = 0; i < c.joint_count; ++i) {
    c.joints[i] = {CommandKind::kImpedance, gate.positions()[i], 0, 1.0, 100.0, 10.0};
  }
  for (int i = 0; i < 2; ++i) c.wheels[i].kind = CommandKind::kVelocity;
  c.gripper = {0.03, 40.0};
  return c;
}

std::array<double, 2> base_velocity(const Command& c) {
  const BaseConfig& b = mabi()->config().base;
  const double left = c.wheels[0].velocity, right = c.wheels[1].velocity;
  return {0.5 * b.wheel_radius_m * (left + right), b.wheel_radius_m * (right - left) / b.track_m};
}

void set_base_velocity(Command& c, double v, double w) {
  const BaseConfig& b = mabi()->config().base;
  c.wheels[0].velocity = (v - 0.5 * b.track_m * w) / b.wheel_radius_m;
  c.wheels[1].velocity = (v + 0.5 * b.track_m * w) / b.wheel_radius_m;
}

bool all_finite(const Command& c) {
  bool ok = std::isfinite(c.gripper.opening_m) && std::isfinite(c.gripper.force_n);
  const auto check = [&](const JointCommand& j) {
    for (const double v : {j.position, j.velocity, j.torque, j.stiffness, j.damping}) {
      ok = ok && std::isfinite(v);
    }
  };
  for (const JointCommand& j : c.joints) check(j);
  for (const JointCommand& j : c.wheels) check(j);
  return ok;
}

// Differentiates the outputs and compares them with the limits of the model.
class Watcher {
 public:
  explicit Watcher(const double* q) { std::copy_n(q, mabi()->joints(), position_.begin()); }

  void check(const SafeCommand& out, Mode mode) {
    const Command& c = out.get();
    ASSERT_TRUE(all_finite(c));
    if (mode == Mode::kIdle) {  // the drives are off: nothing moves
      ASSERT_EQ(c.joint_count, 0);
      velocity_.fill(0.0);
      base_ = {};
      return;
    }
    for (int i = 0; i < mabi()->joints(); ++i) {
      const JointLimits& l = mabi()->limits(i);
      const JointCommand& j = c.joints[i];
      ASSERT_GE(j.position, l.lower);
      ASSERT_LE(j.position, l.upper);
      const double v = (j.position - position_[i]) / kDt;
      ASSERT_NEAR(v, j.velocity, kVelocityRounding);
      ASSERT_LE(std::abs(v), l.velocity + kVelocityRounding);
      ASSERT_LE(std::abs(v - velocity_[i]) / kDt, l.acceleration + kAccelerationRounding);
      ASSERT_LE(std::abs(j.torque), l.torque);
      ASSERT_GE(j.stiffness, 0.0);
      ASSERT_GE(j.damping, 0.0);
      position_[i] = j.position;
      velocity_[i] = v;
    }
    const BaseConfig& b = mabi()->config().base;
    const std::array<double, 2> base = base_velocity(c);
    ASSERT_LE(std::abs(base[0]), b.velocity_max + kVelocityRounding);
    ASSERT_LE(std::abs(base[1]), b.yaw_rate_max + kVelocityRounding);
    if (mode == Mode::kSettle) {  // the brake is on at once
      ASSERT_EQ(base[0], 0.0);
      ASSERT_EQ(base[1], 0.0);
    } else {
      ASSERT_LE(std::abs(base[0] - base_[0]) / kDt, b.acceleration_max + kAccelerationRounding);
      ASSERT_LE(std::abs(base[1] - base_[1]) / kDt, b.yaw_acceleration_max + kAccelerationRounding);
    }
    base_ = base;
    ASSERT_GE(c.gripper.opening_m, 0.0);
    ASSERT_LE(c.gripper.opening_m, mabi()->config().gripper_opening_max_m);
    ASSERT_GE(c.gripper.force_n, 0.0);
  }

 private:
  std::array<double, kMaxJoints> position_{}, velocity_{};
  std::array<double, 2> base_{};
};

// Requests of every kind that a faulty controller could make, together with the reason they must
// get.
struct Nonsense {
  std::mt19937_64 random;

  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  }
  double wild() {
    const double sign = uniform(0, 1) < 0.5 ? -1 : 1;
    switch (random() % 6) {
      case 0:
        return sign * std::numeric_limits<double>::max();
      case 1:
        return sign * 1e200;
      case 2:
        return sign * 1e3;
      case 3:
        return sign * std::numeric_limits<double>::denorm_min();
      default:
        return uniform(-3, 3);
    }
  }
  double broken() {
    const double inf = std::numeric_limits<double>::infinity();
    const double values[] = {inf, -inf, std::nan("")};
    return values[random() % 3];
  }
  Command make(const CommandGate& gate, TimeNs now, bool& sized, bool& fresh, bool& finite) {
    Command c = still_request(gate, now);
    sized = fresh = finite = true;
    for (int i = 0; i < c.joint_count; ++i) {
      c.joints[i].position += uniform(-0.01, 0.01);
      c.joints[i].torque = uniform(-200, 200);
    }
    set_base_velocity(c, uniform(-2, 2), uniform(-2, 2));
    const int joint = static_cast<int>(random() % c.joint_count);
    switch (random() % 12) {
      case 0:
        c.joints[joint].position = wild();
        break;
      case 1:
        for (auto& j : c.joints) j.position = wild();
        break;
      case 2:
        for (auto& w : c.wheels) w.velocity = wild();
        break;
      case 3:
        c.joints[joint].torque = wild();
        break;
      case 4:
        c.joints[joint].stiffness = wild();
        c.joints[joint].damping = wild();
        break;
      case 5:
        c.gripper = {wild(), wild()};
        break;
      case 6:
        sized = false;
        c.joint_count = static_cast<int>(random() % kMaxJoints);
        break;
      case 7:
        sized = false;
        c.wheel_count = random() % 2 ? 0 : 4;
        break;
      case 8:
        fresh = false;
        c.t_ns += random() % 2 ? 1 : -CommandGate::kMemory_ns - 1;
        break;
      case 9: {
        finite = false;
        JointCommand& j = c.joints[joint];
        double* fields[] = {&j.position, &j.velocity, &j.torque, &j.stiffness, &j.damping};
        *fields[random() % 5] = broken();
        break;
      }
      case 10:
        finite = false;
        c.wheels[random() % 2].velocity = broken();
        break;
      case 11:
        finite = false;
        (random() % 2 ? c.gripper.opening_m : c.gripper.force_n) = broken();
        break;
    }
    if (!sized) sized = c.joint_count == mabi()->joints() && c.wheel_count == 2;
    if (random() % 8 == 0) {  // two faults at once
      finite = false;
      c.joints[joint].torque = broken();
    }
    return c;
  }
};

TEST(CommandGate, OutputIsFiniteAndWithinLimitsWhateverIsAsked) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    SCOPED_TRACE(seed);
    Nonsense nonsense{std::mt19937_64(seed)};
    CommandGate gate(mabi());
    gate.reset(mabi()->config().ready.data());
    Watcher watcher(mabi()->config().ready.data());
    Mode mode = Mode::kActive;
    for (int step = 0; step < 4000; ++step) {
      const TimeNs now = kNanosPerSecond + step * kPeriodNs;
      if (nonsense.random() % 50 == 0) mode = static_cast<Mode>(nonsense.random() % 6);
      if (nonsense.random() % 20 == 0) mode = Mode::kActive;
      bool sized, fresh, finite;
      const Command request = nonsense.make(gate, now, sized, fresh, finite);
      const SafeCommand out = gate.step(request, now, kDt, mode);
      ASSERT_NO_FATAL_FAILURE(watcher.check(out, mode)) << "step " << step;
      if (mode != Mode::kActive && mode != Mode::kDegraded) {
        ASSERT_EQ(out.reason(), GateReason::kMode);
      } else if (!sized) {
        ASSERT_EQ(out.reason(), GateReason::kWrongSize);
      } else if (!fresh) {
        ASSERT_EQ(out.reason(), GateReason::kStale);
      } else if (!finite) {
        ASSERT_EQ(out.reason(), GateReason::kNotFinite);
      } else if (out.reason() == GateReason::kNone) {
        for (int i = 0; i < mabi()->joints(); ++i) {  // passed unchanged, but for rounding
          ASSERT_NEAR(out.get().joints[i].position, request.joints[i].position, 1e-14);
          ASSERT_EQ(out.get().joints[i].torque, request.joints[i].torque);
        }
      }
    }
  }
}

TEST(CommandGate, RequestWithinAllLimitsPassesUnchanged) {
  CommandGate gate(mabi());
  gate.reset(mabi()->config().ready.data());
  Command c = still_request(gate, 0);
  for (int i = 0; i < c.joint_count; ++i) {
    c.joints[i].position += 0.9 * mabi()->limits(i).acceleration * kDt * kDt;
  }
  set_base_velocity(c, 0.9 * mabi()->config().base.acceleration_max * kDt, 0.001);
  const SafeCommand out = gate.step(c, 0, kDt, Mode::kActive);
  EXPECT_EQ(out.reason(), GateReason::kNone);
  for (int i = 0; i < c.joint_count; ++i) {
    EXPECT_NEAR(out.get().joints[i].position, c.joints[i].position, 1e-15);
    EXPECT_EQ(out.get().joints[i].stiffness, c.joints[i].stiffness);
    EXPECT_EQ(out.get().joints[i].damping, c.joints[i].damping);
  }
  EXPECT_NEAR(out.get().wheels[0].velocity, c.wheels[0].velocity, 1e-12);
  EXPECT_NEAR(out.get().wheels[1].velocity, c.wheels[1].velocity, 1e-12);
  EXPECT_EQ(out.get().gripper.opening_m, c.gripper.opening_m);
  EXPECT_EQ(out.get().gripper.force_n, c.gripper.force_n);
}

// Runs a request of constant velocities, far beyond the limits and of the given direction.
struct Motion {
  CommandGate gate{mabi()};
  JointVector direction = JointVector::Zero(mabi()->joints());
  double v = 0, w = 0;
  TimeNs now = 0;

  explicit Motion(std::uint64_t seed) {
    gate.reset(mabi()->config().ready.data());
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> uniform(-1, 1);
    for (double& d : direction) d = uniform(random);
    v = 5 * uniform(random);
    w = 5 * uniform(random);
  }
  SafeCommand step(Mode mode) {
    now += kPeriodNs;
    Command c = still_request(gate, now);
    for (int i = 0; i < c.joint_count; ++i) c.joints[i].position += 20.0 * direction[i] * kDt;
    set_base_velocity(c, v, w);
    return gate.step(c, now, kDt, mode);
  }
};

void expect_along(const SafeCommand& out, const Motion& m) {
  JointVector dq(mabi()->joints());
  for (int i = 0; i < dq.size(); ++i) dq[i] = out.get().joints[i].velocity;
  const JointVector unit = m.direction.normalized();
  EXPECT_LE((dq - unit * unit.dot(dq)).norm(), kVelocityRounding);
  EXPECT_GE(unit.dot(dq), -kVelocityRounding);
  const std::array<double, 2> base = base_velocity(out.get());
  EXPECT_NEAR(base[0] * m.w, base[1] * m.v, kVelocityRounding);
  EXPECT_GE(base[0] * m.v, -kVelocityRounding);
}

TEST(CommandGate, ScalingKeepsTheDirectionOfMotionAndTheCurvatureOfTheBase) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    Motion m(seed);
    for (int i = 0; i < 100;
         ++i) {  // 0.25 s: accelerating, then at the limit; far from position limits
      const SafeCommand out = m.step(Mode::kActive);
      EXPECT_EQ(out.reason(), GateReason::kScaled);
      expect_along(out, m);
    }
  }
}

TEST(CommandGate, FallbackSlowsDownAlongThePathAndStandsStill) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    for (const Mode mode : {Mode::kReady, Mode::kHold}) {
      Motion m(seed);
      SafeCommand out;
      for (int i = 0; i < 100; ++i) out = m.step(Mode::kActive);
      double speed = std::hypot(base_velocity(out.get())[0], out.get().joints[0].velocity);
      // The longest stop: the base from 1 m/s at 1 m/s^2, or the shoulder from 1.31 rad/s at 4
      // rad/s^2.
      const int stop_steps = static_cast<int>(1.0 / kDt) + 1;
      for (int i = 0; i < stop_steps; ++i) {
        out = m.step(mode);
        EXPECT_EQ(out.reason(), GateReason::kMode);
        expect_along(out, m);
        const double now = std::hypot(base_velocity(out.get())[0], out.get().joints[0].velocity);
        EXPECT_LE(now, speed + kVelocityRounding);
        speed = now;
      }
      const auto rest = m.gate.positions();
      out = m.step(mode);
      EXPECT_EQ(m.gate.positions(), rest);
      for (int i = 0; i < mabi()->joints(); ++i) EXPECT_EQ(out.get().joints[i].velocity, 0.0);
      EXPECT_EQ(out.get().wheels[0].velocity, 0.0);
      EXPECT_EQ(out.get().wheels[1].velocity, 0.0);
      EXPECT_EQ(out.get().gripper.force_n, 40.0) << "the grip stays";
    }
  }
}

TEST(CommandGate, SettleBrakesTheWheelsAtOnceAndTheArmWithinItsLimits) {
  Motion m(1);
  for (int i = 0; i < 100; ++i) (void)m.step(Mode::kActive);
  const SafeCommand out = m.step(Mode::kSettle);
  EXPECT_EQ(out.get().wheels[0].velocity, 0.0);
  EXPECT_EQ(out.get().wheels[1].velocity, 0.0);
  EXPECT_NE(out.get().joints[0].velocity, 0.0);
  expect_along(out, m);
}

TEST(CommandGate, IdleGivesTheEmptyCommand) {
  CommandGate gate(mabi());
  gate.reset(mabi()->config().ready.data());
  const SafeCommand out = gate.step(still_request(gate, 0), 0, kDt, Mode::kIdle);
  EXPECT_EQ(out.reason(), GateReason::kMode);
  EXPECT_EQ(out.get().joint_count, 0);
  EXPECT_EQ(out.get().wheel_count, 0);
  for (const JointCommand& j : out.get().joints) EXPECT_EQ(j.kind, CommandKind::kNone);
}

TEST(CommandGate, RefusedNumbersNeverComeOutOfTheFallback) {
  // In HOLD the mode refuses first; a request that is no numbers must not lend its torque even
  // then.
  for (const Mode mode : {Mode::kActive, Mode::kReady, Mode::kHold, Mode::kSettle}) {
    CommandGate gate(mabi());
    gate.reset(mabi()->config().ready.data());
    (void)gate.step(still_request(gate, 0), 0, kDt, Mode::kActive);
    Command c = still_request(gate, 0);
    for (JointCommand& j : c.joints) j.torque = j.stiffness = j.damping = std::nan("");
    c.gripper.force_n = std::nan("");
    const SafeCommand out = gate.step(c, 0, kDt, mode);
    EXPECT_TRUE(all_finite(out.get()));
    EXPECT_EQ(out.get().joints[0].stiffness, 100.0) << "stands still as it was last told to";
    EXPECT_EQ(out.get().gripper.force_n, 40.0);
  }
}

TEST(CommandGate, SetPointBrakesBeforeItsRangeEndsAndReachesTheEnd) {
  for (int joint = 0; joint < mabi()->joints(); ++joint) {
    for (const bool up : {false, true}) {
      CommandGate gate(mabi());
      gate.reset(mabi()->config().ready.data());
      Watcher watcher(mabi()->config().ready.data());
      const JointLimits& l = mabi()->limits(joint);
      bool clipped = false;
      for (int i = 0; i < 6000; ++i) {  // 15 s: 10.5 rad at 1.3 rad/s take 8.3 s
        const TimeNs now = i * kPeriodNs;
        Command c = still_request(gate, now);
        c.joints[joint].position = up ? l.upper + 1 : l.lower - 1;
        // The others shake, which must not take the braking away from this one.
        for (int j = 0; j < c.joint_count; ++j) {
          if (j != joint) c.joints[j].position += i % 2 ? 0.05 : -0.05;
        }
        const SafeCommand out = gate.step(c, now, kDt, Mode::kActive);
        ASSERT_NO_FATAL_FAILURE(watcher.check(out, Mode::kActive)) << "joint " << joint;
        clipped = clipped || out.reason() == GateReason::kClipped;
      }
      EXPECT_TRUE(clipped);
      EXPECT_NEAR(gate.positions()[joint], up ? l.upper : l.lower, 1e-9);
    }
  }
}

TEST(CommandGate, SetPointThatStartsOutsideItsRangeOnlyMovesInwards) {
  std::vector<double> q = mabi()->config().ready;
  q[1] = mabi()->limits(1).upper + 0.05;
  CommandGate gate(mabi());
  gate.reset(q.data());
  Command out_of_range = still_request(gate, 0);
  out_of_range.joints[1].position += 0.1;
  (void)gate.step(out_of_range, 0, kDt, Mode::kActive);
  EXPECT_EQ(gate.positions()[1], q[1]);
  Command stay = still_request(gate, 0);
  (void)gate.step(stay, 0, kDt, Mode::kActive);
  EXPECT_EQ(gate.positions()[1], q[1]) << "nothing was asked to move";
  Command inwards = still_request(gate, 0);
  inwards.joints[1].position -= 0.1;
  (void)gate.step(inwards, 0, kDt, Mode::kActive);
  EXPECT_LT(gate.positions()[1], q[1]);
}

TEST(CommandGate, ResetStandsStillAtTheMeasuredPosture) {
  Motion m(2);
  for (int i = 0; i < 100; ++i) (void)m.step(Mode::kActive);
  m.gate.reset(mabi()->config().stowed.data());
  m.direction.setZero();
  m.v = m.w = 0;
  const SafeCommand out = m.step(Mode::kActive);
  EXPECT_EQ(out.reason(), GateReason::kNone);
  for (int i = 0; i < mabi()->joints(); ++i) {
    EXPECT_EQ(out.get().joints[i].position, mabi()->config().stowed[i]);
    EXPECT_EQ(out.get().joints[i].velocity, 0.0);
  }
}

TEST(CommandGate, StepDoesNotAllocate) {
  Motion m(3);
  const std::uint64_t before = thread_allocations();
  for (int i = 0; i < 100; ++i) (void)m.step(i % 10 ? Mode::kActive : Mode::kHold);
  EXPECT_EQ(thread_allocations(), before);
}

}  // namespace
}  // namespace wb
