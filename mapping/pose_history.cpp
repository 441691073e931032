#include "mapping/pose_history.hpp"

#include <algorithm>
#include <cmath>

namespace wb {

PoseHistory::PoseHistory(int base_dof, int joints)
    : base_dof_(base_dof), joints_(joints), ring_(kCapacity) {}

void PoseHistory::push(const RobotState& state) RT_SAFE {
  if (state.joint_count != joints_) return;
  if (count_ > 0 && state.t_ns <= sample(count_ - 1).t_ns) return;
  Sample next;
  next.t_ns = state.t_ns;
  std::copy_n(state.base.begin(), base_dof_, next.x.begin());
  std::copy_n(state.q.begin(), joints_, next.x.begin() + base_dof_);
  // The bound keeps voxel indices far within an int; nothing real comes near it.
  constexpr double kLargest = 1e6;
  for (int i = 0; i < base_dof_ + joints_; ++i) {
    if (!(std::abs(next.x[i]) < kLargest)) return;
  }
  if (count_ == kCapacity) {
    first_ = (first_ + 1) % kCapacity;
    --count_;
  }
  ring_[(first_ + count_++) % kCapacity] = next;
}

bool PoseHistory::at(TimeNs t, State& x) const RT_SAFE {
  if (count_ == 0 || t < sample(0).t_ns || t > sample(count_ - 1).t_ns + kFutureNs) return false;
  // Bisection: the last sample at or before t.
  int low = 0, high = count_;
  while (high - low > 1) {
    const int middle = (low + high) / 2;
    (sample(middle).t_ns <= t ? low : high) = middle;
  }
  const Sample& a = sample(low);
  const Sample& b = sample(std::min(low + 1, count_ - 1));
  const TimeNs span = b.t_ns - a.t_ns;
  const double s = span > 0 ? static_cast<double>(t - a.t_ns) / static_cast<double>(span) : 0.0;
  for (int i = 0; i < base_dof_ + joints_; ++i) x[i] = a.x[i] + s * (b.x[i] - a.x[i]);
  return true;
}

std::array<double, 2> PoseHistory::newest_base() const RT_SAFE {
  if (count_ == 0 || base_dof_ == 0) return {0.0, 0.0};
  const Sample& newest = sample(count_ - 1);
  return {newest.x[0], newest.x[1]};
}

}  // namespace wb
