// A robot without dynamics behind the low-level side: joints run to what they were commanded at
// their velocity limit and stand still otherwise. Any thread may look at it; the low-level thread
// calls it.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <mutex>

#include "drivers/dds/exchange.hpp"
#include "drivers/dds/low_level/low_level.hpp"

namespace wb::dds {

inline wb_description fake_description(int arm = 3, int wheels = 2) {
  wb_description d{};
  std::strcpy(d.name, "fake");
  for (int i = 0; i < arm + wheels; ++i) {
    wb_joint_info& j = d.joints[d.joint_count++];
    const bool wheel = i >= arm;
    std::snprintf(j.name, sizeof j.name, "%s_%d", wheel ? "wheel" : "joint", wheel ? i - arm : i);
    j.position_min = wheel ? 0 : -2;
    j.position_max = wheel ? 0 : 2;
    j.velocity_max = 1.5;
    j.effort_max = 20;
    j.command_kinds =
        wheel ? 1u << WB_CMD_VELOCITY : (1u << WB_CMD_IMPEDANCE) | (1u << WB_CMD_VELOCITY);
    j.is_wheel = wheel;
  }
  d.has_imu = d.has_wrench = d.has_gripper = d.has_emergency_stop = 1;
  return d;
}

class FakeRobot : public LowLevelRobot {
 public:
  FakeRobot(const wb_description& description, bool paced)
      : description_(description), paced_(paced) {
    readings_.imu = {{0.01, 0.02, 0.03}, {0, 0, 9.81}, 1};
    readings_.wrench = {{1, 2, 3}, {0.1, 0.2, 0.3}, 1};
    readings_.gripper = {0.04, 0, 1};
    for (std::uint32_t i = 0; i < description.joint_count; ++i) readings_.joints[i].valid = 1;
  }

  // Broken ways, for tests of who finds out.
  bool ignores_stop = false;
  bool moves_by_itself = false;

  void read(wb_readings& out) override {
    const std::lock_guard lock(mutex_);
    if (!paced_) run_to(clock_ns(CLOCK_REALTIME));
    readings_.t_ns = t_ns_;
    out = readings_;
  }
  void apply(const wb_commands& commands) override {
    const std::lock_guard lock(mutex_);
    if (!paced_) run_to(clock_ns(CLOCK_REALTIME));
    commands_ = commands;
    moving_ = true;
    ++applied_;
    if (commands.gripper.force > 0) readings_.gripper.opening = commands.gripper.opening;
  }
  void stop(const wb_timeout_action* actions) override {
    const std::lock_guard lock(mutex_);
    if (!paced_) run_to(clock_ns(CLOCK_REALTIME));
    if (ignores_stop) return;
    std::copy_n(actions, WB_DRIVER_MAX_JOINTS, stop_actions_);
    moving_ = false;
    stopped_t_ns_ = t_ns_;
    ++stops_;
    for (auto& j : readings_.joints) j.velocity = 0;
  }
  bool advance(TimeNs t) override {
    const std::lock_guard lock(mutex_);
    run_to(t);
    return true;
  }

  // For the test.
  template <class Look>
  auto with(Look&& look) {
    const std::lock_guard lock(mutex_);
    return look(*this);
  }
  wb_readings readings() {
    return with([](FakeRobot& r) { return r.readings_; });
  }
  double position(int i) { return readings().joints[i].position; }
  // Of all joints together since the start, rad.
  double travel() {
    return with([](FakeRobot& r) { return r.travel_; });
  }
  int applied() {
    return with([](FakeRobot& r) { return r.applied_; });
  }
  int stops() {
    return with([](FakeRobot& r) { return r.stops_; });
  }
  wb_commands commands() {
    return with([](FakeRobot& r) { return r.commands_; });
  }
  int stop_action(int i) {
    return with([&](FakeRobot& r) { return static_cast<int>(r.stop_actions_[i]); });
  }
  TimeNs stopped_t_ns() {
    return with([](FakeRobot& r) { return r.stopped_t_ns_; });
  }
  void press_emergency_stop(bool pressed) {
    with([&](FakeRobot& r) { r.readings_.emergency_stop = pressed; });
  }
  void fail_joint(int i, std::uint32_t error) {
    with([&](FakeRobot& r) { r.readings_.joints[i].error_code = error; });
  }
  void age_joint(int i, TimeNs age) {
    with([&](FakeRobot& r) { r.readings_.joints[i].age_ns = age; });
  }
  void set_position(int i, double value) {
    with([&](FakeRobot& r) { r.readings_.joints[i].position = value; });
  }

 private:
  void run_to(TimeNs t) {
    const double dt = t_ns_ == 0 && !paced_ ? 0 : std::max(0.0, to_seconds(t - t_ns_));
    t_ns_ = t;
    for (std::uint32_t i = 0; i < description_.joint_count; ++i) {
      auto& j = readings_.joints[i];
      const auto& c = commands_.joints[i];
      double v = 0;
      const double reach = description_.joints[i].velocity_max;
      if (moving_ && c.kind == WB_CMD_VELOCITY) v = c.velocity;
      if (moving_ && c.kind == WB_CMD_IMPEDANCE && dt > 0)
        v = std::clamp((c.position - j.position) / dt, -reach, reach);
      if (moves_by_itself) v = 0.2;
      j.velocity = v;
      j.position += v * dt;
      travel_ += std::abs(v) * dt;
    }
  }

  std::mutex mutex_;
  const wb_description description_;
  const bool paced_;
  TimeNs t_ns_ = 0;
  wb_readings readings_{};
  wb_commands commands_{};
  bool moving_ = false;
  double travel_ = 0;
  int applied_ = 0, stops_ = 0;
  TimeNs stopped_t_ns_ = 0;
  wb_timeout_action stop_actions_[WB_DRIVER_MAX_JOINTS] = {};
};

}  // namespace wb::dds
