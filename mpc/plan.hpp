// A trajectory with its gains, on a time grid of the solver's: what the MPC keeps from call to
// call. Step world once resized. A Policy is the part of it that is handed over.
#pragma once
#include <algorithm>
#include <vector>

#include "core/types/policy.hpp"
#include "mpc/optimal_control_problem.hpp"

namespace wb {

struct Plan {
  int nodes = 0;  // 0: none. The last node has no input
  std::vector<TimeNs> t;
  std::vector<StateVector> x;
  std::vector<InputVector> u;
  std::vector<InputStateMatrix> K;

  // Setup world.
  Plan(int most, int states, int inputs)
      : t(most),
        x(most, StateVector::Zero(states)),
        u(most, InputVector::Zero(inputs)),
        K(most, InputStateMatrix::Zero(inputs, states)) {}

  // Input and state at a time, by the rule of Policy::evaluate.
  bool evaluate(TimeNs now, const StateVector& x_now, InputVector& u_now) const noexcept {
    if (nodes < 2 || now >= t[nodes - 1]) return false;
    const int i = node_at(now);
    const double s = std::clamp(
        static_cast<double>(now - t[i]) / static_cast<double>(t[i + 1] - t[i]), 0.0, 1.0);
    u_now = u[i];
    u_now.noalias() += K[i].lazyProduct(x_now - (1.0 - s) * x[i] - s * x[i + 1]);
    return true;
  }

  // The node whose input acts at `now`: the last one at or before it, the first for earlier times.
  int node_at(TimeNs now) const noexcept {
    const auto after = std::upper_bound(t.begin(), t.begin() + nodes, now);
    return std::max(0, static_cast<int>(after - t.begin()) - 1);
  }

  // Takes over a policy's trajectory.
  void take(const Policy& policy) noexcept {
    nodes = std::min(policy.nodes, static_cast<int>(t.size()));
    for (int i = 0; i < nodes; ++i) {
      t[i] = policy.t[i];
      x[i] = policy.x(i);
      u[i] = policy.u(i);
      K[i] = policy.K(i);
    }
  }

  void hand_over(Policy& policy) const noexcept {
    policy.nodes = std::min(nodes, kMaxNodes);
    policy.states = static_cast<int>(x[0].size());
    policy.inputs = static_cast<int>(u[0].size());
    for (int i = 0; i < policy.nodes; ++i) {
      policy.t[i] = t[i];
      policy.x(i) = x[i];
      policy.u(i) = u[i];
      policy.K(i) = K[i];
    }
  }
};

// `from` seen from another grid of `nodes` times: states interpolated, inputs averaged over the new
// intervals (which keeps where they lead), gains of the node in force. Without nodes: stay at x0.
inline void shift(const Plan& from, const std::vector<TimeNs>& t, int nodes, const double* x0,
                  Plan& to) noexcept {
  to.nodes = nodes;
  std::copy_n(t.begin(), nodes, to.t.begin());
  const bool none = from.nodes < 2;
  for (int i = 0; i < nodes; ++i) {
    to.u[i].setZero();
    to.K[i].setZero();
    if (none) {
      for (int r = 0; r < to.x[i].size(); ++r) to.x[i][r] = std::isfinite(x0[r]) ? x0[r] : 0.0;
      continue;
    }
    const int k = std::min(from.node_at(t[i]), from.nodes - 2);
    const double s = std::clamp(
        static_cast<double>(t[i] - from.t[k]) / static_cast<double>(from.t[k + 1] - from.t[k]), 0.0,
        1.0);
    to.x[i] = (1.0 - s) * from.x[k] + s * from.x[k + 1];
    if (i + 1 == nodes || t[i] >= from.t[from.nodes - 1]) continue;
    to.K[i] = from.K[k];
    for (int j = k; j + 1 < from.nodes; ++j) {
      const TimeNs begins = j == k ? t[i] : from.t[j];
      if (begins >= t[i + 1]) break;
      const double part = static_cast<double>(std::min(from.t[j + 1], t[i + 1]) - begins) /
                          static_cast<double>(t[i + 1] - t[i]);
      to.u[i] += part * from.u[j];
    }
  }
}

}  // namespace wb
