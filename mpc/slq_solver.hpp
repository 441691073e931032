// SLQ model predictive control: Gauss-Newton steps about a rolled-out trajectory, warm start
// shifted in time, one step a call (real-time iteration) or as many as it takes (converge). MPC
// loop, step world: noexcept, no allocation, no clock; the work of a call depends on grid and terms
// only. SI units, frame W. Source: Farshidian et al. 2017 (SLQ); Mittal et al. 2022, Sec. IV;
// docs/decisions/0003-rolled-out-slq.md.
#pragma once
#include <memory>

#include "core/rt/rt_safe.hpp"
#include "core/types/distance_field.hpp"
#include "core/types/policy.hpp"
#include "core/types/reference.hpp"
#include "core/types/weights.hpp"
#include "mpc/solve_report.hpp"

namespace wb {

struct SolveInput {
  TimeNs t0 = 0;
  const double* x0 = nullptr;  // nx() entries: base x, y [m], yaw [rad]; q
  const Reference* reference = nullptr;
  const DistanceField* field = nullptr;  // may be null or empty: no map yet
  // Another warm start, taken where it costs less than the last policy; may be null.
  const Policy* guess = nullptr;
  const Weights* weights = nullptr;  // null: as configured
};

// Largest counts of a call, from grid, terms and settings.
struct WorkBound {
  int node_evaluations = 0, term_evaluations = 0, factorisations = 0;
};

// Cost to go from a node of the last solve: value + gradient'dx + dx'Hessian dx / 2.
struct ValueFunction {
  double value = 0;  // of the trajectory that the problem was linearised about
  StateVector gradient;
  StateMatrix hessian;
};

class SlqSolver {
 public:
  explicit SlqSolver(std::shared_ptr<const OptimalControlProblem> problem);
  ~SlqSolver();

  // One iteration from x0. `policy` is overwritten: always finite, its inputs within the velocity
  // limits, never dearer than the last one shifted. Policies longer than kMaxNodes are cut there.
  [[nodiscard]] SolveStatus solve(const SolveInput& input, Policy& policy,
                                  SolveReport& report) RT_SAFE;
  // Iterates until the feed-forward moves no input by more than `tolerance` (unit of u), or
  // `iterations` times. Returns how many it took; SQP mode, for studies and ranking.
  int converge(const SolveInput& input, int iterations, double tolerance, Policy& policy,
               SolveReport& report) RT_SAFE;
  // Forgets the warm start (a new task from an unrelated state).
  void reset() RT_SAFE;

  const SolverCounters& counters() const;
  WorkBound work_bound() const;  // of solve()
  // The trajectory of the last solve, all of its nodes; the cost to go at its first node.
  std::span<const StateVector> states() const;
  std::span<const InputVector> inputs() const;
  ValueFunction value_function() const;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace wb
