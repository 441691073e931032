// The MPC loop's step: base route where the reference asks for one, then one SLQ iteration. 30 Hz,
// step world. Input: newest RobotState, Reference and DistanceField; output: Policy. Frame W, SI.
#pragma once
#include <memory>

#include "core/types/robot_state.hpp"
#include "mpc/slq_solver.hpp"
#include "planning/base_route.hpp"

namespace wb {

class MotionPlanner {
 public:
  // Reads robot_folder/mpc.yaml and, if the base drives, route.yaml. `disabled_terms`: names of MPC
  // terms to leave out (studies only).
  MotionPlanner(std::shared_ptr<const RobotModel> model,
                const std::vector<std::string>& disabled_terms = {});

  // `weights`: null: as configured.
  [[nodiscard]] SolveStatus step(const RobotState& state, const Reference& reference,
                                 const DistanceField* field, Policy& policy, SolveReport& report,
                                 const Weights* weights = nullptr) RT_SAFE;

  // Forgets the warm start: call before the first step after control did not follow the policy.
  void reset() RT_SAFE { solver_.reset(); }

  const Reference& expanded_reference() const { return reference_; }  // with the route, for views
  const SolverCounters& counters() const { return solver_.counters(); }
  const OptimalControlProblem& problem() const { return *problem_; }

 private:
  void guess_from_route(const std::array<double, kMaxStates>& x0) RT_SAFE;

  std::shared_ptr<const RobotModel> model_;
  std::shared_ptr<const OptimalControlProblem> problem_;
  SlqSolver solver_;
  std::unique_ptr<BaseRoute> route_;  // none of a fixed base
  Reference reference_;
  Policy guess_;  // inputs that follow the route, arm at rest
};

}  // namespace wb
