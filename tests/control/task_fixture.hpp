// Runs a TaskSequencer against the ideal plant, tick by tick, and checks on every tick what holds
// in all tasks.
#pragma once
#include <gtest/gtest.h>

#include <functional>

#include "control/task_sequencer.hpp"
#include "tests/control/ideal_plant.hpp"

namespace wb::control_test {

inline constexpr double kTickS = 0.01;

struct Limits {  // of control.yaml
  config::Section s = control_section("sequencer"), times = s.section("time_limits");
  double time(const std::string& key) const { return times.number(key); }
  double number(const std::string& key) const { return s.number(key); }
};

class TaskRun {
 public:
  explicit TaskRun(const Unit& unit)
      : plant(unit), sequencer(mabi(), control_section("sequencer")) {
    request.kind = RequestKind::kOpen;
    request.object = Name("unit");
    request.t_ns = t;
  }

  IdealPlant plant;
  TaskSequencer sequencer;
  Request request;
  RobotState state;
  Reference reference;
  TaskOutput out;
  TimeNs t = 10 * kNanosPerSecond;
  bool plans = true, measures = true;
  std::vector<Phase> phases;                 // as they followed each other
  std::vector<double> lasted_s;              // how long each of them
  std::function<void(TaskRun&)> every_tick;  // called before the plant moves

  int count(Phase p) const { return static_cast<int>(std::count(phases.begin(), phases.end(), p)); }
  Phase last() const { return phases.back(); }
  double lasted(Phase p) const {
    return lasted_s[std::find(phases.begin(), phases.end(), p) - phases.begin()];
  }

  void run() {
    state.t_ns = t;
    plant.fill(state);
    sequencer.start(request, state);
    for (int tick = 0; tick < 12000 && !out.ended; ++tick) {
      ASSERT_NO_FATAL_FAILURE(step());
    }
    ASSERT_TRUE(out.ended) << "still in phase " << to_string(out.phase);
    EXPECT_FALSE(sequencer.busy());
  }

  void step() {
    plant.fill(state);
    state.t_ns = t;
    const ObjectPlan plan = plant.unit.plan(t, measures && out.phase == Phase::kPreGrasp);
    const Phase before = out.phase;
    out = sequencer.step({t, kTickS, &state, plans ? &plan : nullptr}, reference);
    if (phases.empty() || phases.back() != out.phase) {
      phases.push_back(out.phase);
      lasted_s.push_back(0);
    }
    lasted_s.back() += kTickS;
    ASSERT_NO_FATAL_FAILURE(check(before));
    if (every_tick) every_tick(*this);
    plant.step(reference, out.gripper, t, kTickS);
    t += from_seconds(kTickS);
  }

 private:
  void check(Phase before) const {
    for (int i = 0; i < reference.ee[0].count; ++i) {
      ASSERT_TRUE(reference.ee[0].keyframes[i].X_WE.isometry().matrix().allFinite());
      ASSERT_NEAR(reference.ee[0].keyframes[i].X_WE.rotation().norm(), 1.0, 1e-9);
      ASSERT_TRUE(i == 0 ||
                  reference.ee[0].keyframes[i].t_ns > reference.ee[0].keyframes[i - 1].t_ns);
    }
    // The tick that leaves a phase still has that phase's outputs.
    const bool may_close = before == Phase::kGrasp || before == Phase::kManipulate;
    ASSERT_TRUE(may_close || out.gripper.opening_m == mabi()->config().gripper_opening_max_m);
    ASSERT_TRUE(!out.held || out.phase == Phase::kManipulate || before == Phase::kManipulate);
    const bool at_object = before == Phase::kPreGrasp || before == Phase::kGrasp ||
                           before == Phase::kManipulate || before == Phase::kRelease ||
                           before == Phase::kRetreat;
    if (out.ended) return;  // a reference that nobody follows any more
    for (const MaskBox& m : reference.masks) ASSERT_EQ(m.active, at_object) << to_string(before);
  }
};

}  // namespace wb::control_test
