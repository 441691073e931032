// SLQ model predictive control by real-time iteration: one Gauss-Newton step a call, warm start
// shifted in time. MPC loop, step world: solve() is noexcept and neither allocates nor reads a
// clock. SI units, frame W. Source: Farshidian et al. 2017 (SLQ); Mittal et al. 2022, Sec. IV;
// DESIGN.md, "Formulation of the MPC".
#pragma once
#include <memory>
#include <string_view>

#include "core/rt/rt_safe.hpp"
#include "core/types/distance_field.hpp"
#include "core/types/policy.hpp"
#include "core/types/reference.hpp"
#include "mpc/optimal_control_problem.hpp"

namespace wb {

enum class SolveStatus : std::uint8_t {
  kConverging,  // a step was accepted
  kNoStep,      // the line search accepted nothing; the policy is the last one, shifted
  kNotFinite,   // trouble in state, reference or derivatives; the policy is the last one, shifted
};
std::string_view to_string(SolveStatus status);

struct SolveInput {
  TimeNs t0 = 0;
  const double* x0 = nullptr;  // nx() entries: base x, y [m], yaw [rad]; q
  const Reference* reference = nullptr;
  const DistanceField* field = nullptr;  // may be null or empty: no map yet
  // Another warm start, taken where it costs less than the last policy; may be null.
  const Policy* guess = nullptr;
};

// What a solve did; fixed size, part of the MPC step's record.
struct SolveReport {
  SolveStatus status = SolveStatus::kConverging;
  double cost_before = 0, cost_after = 0;  // of the warm start and of the result
  double defect = 0;  // largest dynamics defect of the result; 0, results are rolled out
  double step = 0;    // accepted step length, 0 if none
  int line_search_steps = 0;
  int nodes = 0;
  std::array<double, kMaxTerms> term_cost{};  // by the problem's term index, of the result
  int active_environment_spheres = 0;         // spheres whose hinge is active on some node
};

class SlqSolver {
 public:
  explicit SlqSolver(std::shared_ptr<const OptimalControlProblem> problem);
  ~SlqSolver();

  // One iteration from x0. `policy` is overwritten: always finite, its inputs within the velocity
  // limits.
  [[nodiscard]] SolveStatus solve(const SolveInput& input, Policy& policy,
                                  SolveReport& report) RT_SAFE;
  // Forgets the warm start (a new task from an unrelated state).
  void reset() RT_SAFE;

 private:
  struct Workspace;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace wb
