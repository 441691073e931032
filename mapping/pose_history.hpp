// Where the robot was: the last states, so that a depth frame finds the configuration at its stamp.
// Mapping loop, step world. x = (base x, y [m], yaw [rad]; q) as RobotModel takes it; linear
// between two states.
#pragma once
#include <array>
#include <vector>

#include "core/rt/rt_safe.hpp"
#include "core/types/limits.hpp"
#include "core/types/robot_state.hpp"
#include "core/types/time.hpp"

namespace wb {

class PoseHistory {
 public:
  using State = std::array<double, kMaxStates>;
  static constexpr int kCapacity = 512;               // 1.28 s at 400 Hz
  static constexpr TimeNs kFutureNs = 5 * 1'000'000;  // DESIGN.md, "Contracts", time

  // A base with base_dof = 3 takes the first three entries of x; 0: x is q alone.
  PoseHistory(int base_dof, int joints);

  // Ignores a state that is no newer than the last, has other joints than the robot, or is not
  // finite.
  void push(const RobotState& state) RT_SAFE;
  // The configuration at t; false when t is older than the history or more than kFutureNs newer
  // than it.
  [[nodiscard]] bool at(TimeNs t, State& x) const RT_SAFE;

  bool empty() const { return count_ == 0; }
  // x, y of the base in the newest state; zero for a fixed base or an empty history.
  std::array<double, 2> newest_base() const RT_SAFE;

 private:
  struct Sample {
    TimeNs t_ns = 0;
    State x{};
  };
  // i-th sample from the oldest.
  const Sample& sample(int i) const { return ring_[(first_ + i) % kCapacity]; }

  int base_dof_, joints_;
  std::vector<Sample> ring_;
  int first_ = 0, count_ = 0;
};

}  // namespace wb
