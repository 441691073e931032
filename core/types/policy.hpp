// Affine feedback policy of the MPC: u(t, x) = u_ref(t) + K(t) (x - x_ref(t)). Written by MPC,
// evaluated by control. x = (base x, y [m], yaw [rad]; q), u = (v [m/s], w [rad/s]; dq) for a
// differential-drive base, (vx, vy, w; dq) in B for an omnidirectional one. Source: Farshidian et
// al. 2017 (SLQ); Mittal et al. 2022, Sec. IV.
#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/time.hpp"

namespace wb {

// How far the solve behind a policy came.
enum class PolicyQuality : std::uint8_t {
  kFull,
  kShortened,  // solved up to the first node where something was not a number
  kKept,       // not solved: the last policy, shifted in time
};

struct Policy {
  std::uint64_t seq = 0;
  PolicyQuality quality = PolicyQuality::kFull;
  TimeNs t_ns = 0;  // time of the state that it was solved from
  std::uint64_t reference_seq = 0;
  std::uint64_t field_seq = 0;  // 0: no map was at hand
  int nodes = 0;  // node i is (t[i], x[i]); input and gain of node i act on [t[i], t[i+1]); the
                  // last has none
  int states = 0;
  int inputs = 0;
  std::array<TimeNs, kMaxNodes> t{};
  std::array<double, kMaxNodes * kMaxStates> x_data{};
  std::array<double, kMaxNodes * kMaxInputs> u_data{};
  std::array<double, kMaxNodes * kMaxInputs * kMaxStates>
      k_data{};  // column-major inputs x states, packed

  Eigen::Map<Eigen::VectorXd> x(int i) { return {x_data.data() + i * states, states}; }
  Eigen::Map<Eigen::VectorXd> u(int i) { return {u_data.data() + i * inputs, inputs}; }
  Eigen::Map<Eigen::MatrixXd> K(int i) {
    return {k_data.data() + i * inputs * states, inputs, states};
  }
  Eigen::Map<const Eigen::VectorXd> x(int i) const { return {x_data.data() + i * states, states}; }
  Eigen::Map<const Eigen::VectorXd> u(int i) const { return {u_data.data() + i * inputs, inputs}; }
  Eigen::Map<const Eigen::MatrixXd> K(int i) const {
    return {k_data.data() + i * inputs * states, inputs, states};
  }

  // Reference state and input of the policy at time t, and with feedback at (t, x). Sizes: states,
  // inputs. Times before the first node use the first. From the last node on: the last state, zero
  // input, and false.
  [[nodiscard]] bool evaluate(TimeNs t, const double* x_now, double* u_out,
                              double* x_ref_out) const noexcept;
};

}  // namespace wb
