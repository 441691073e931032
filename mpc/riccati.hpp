// One backward sweep of the constrained LQ problem of an SLQ step: feed-forward k within a box and
// on the equalities, feedback K. Step world: noexcept, no allocation, bounded work. Common sizes
// are compiled in, all others share a version with run-time sizes. Minimises the sum of stage and
// terminal Quadratic over du = k + K dx with dx+ = A dx + B du, lower <= k <= upper, e + C dx + D
// du = 0. Source: Tassa, Mansard and Todorov 2014 (control-limited DDP); Farshidian et al. 2017,
// Sec. III (projection of state-input equalities).
#pragma once
#include <span>

#include "mpc/optimal_control_problem.hpp"

namespace wb {

struct LqStage {
  StateMatrix A;
  StateInputMatrix B;
  Quadratic cost;
  InputVector lower, upper;  // of k; lower <= upper
  Equality equality;
  InputStateMatrix K;  // result; rows of inputs that k holds at a bound are zero
  InputVector k;       // result; on entry the guess of which bounds hold
  // Result: cost to go from this node, v'dx + dx'V dx / 2 and a constant.
  StateMatrix V;
  StateVector v;
};

struct LqResult {
  bool finite = false;
  int failed_stage = -1;  // where it stopped: H was not positive
  int factorisations = 0;
  // Predicted change of cost for a step length a: a * linear + a^2 * quadratic / 2.
  double linear = 0, quadratic = 0;
};

// Factorisations of one stage are at most so many.
inline constexpr int kMaxStageFactorisations = 11;

// `regularisation` is added to the diagonal of every stage's R.
LqResult solve_lq(std::span<LqStage> stages, const Quadratic& terminal,
                  double regularisation) noexcept;

}  // namespace wb
