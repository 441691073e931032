// One backward sweep of the input-constrained LQ problem of an SLQ step: feed-forward k within a
// box, feedback K. Step world: noexcept, no allocation. Sizes 9 x 8 (mobile arm of six joints) and
// 6 x 6 are compiled in, all others share a version with run-time sizes. Minimises sum of stage and
// terminal Quadratic over du = k + K dx, dx+ = A dx + B du, lower <= k <= upper. Source: Tassa,
// Mansard and Todorov 2014 (control-limited DDP).
#pragma once
#include <span>

#include "mpc/optimal_control_problem.hpp"

namespace wb {

using InputStateMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxInputs, kMaxStates>;

struct LqStage {
  StateMatrix A;
  StateInputMatrix B;
  Quadratic cost;
  InputVector lower, upper;  // of k; lower <= upper
  InputStateMatrix K;        // result; rows of inputs that k holds at a bound are zero
  InputVector k;             // result; on entry the guess of which bounds hold
};

struct LqResult {
  bool finite = false;
  // Predicted change of cost for a step length a: a * linear + a^2 * quadratic / 2.
  double linear = 0, quadratic = 0;
};

// `regularisation` is added to the diagonal of every stage's R.
LqResult solve_lq(std::span<LqStage> stages, const Quadratic& terminal,
                  double regularisation) noexcept;

}  // namespace wb
