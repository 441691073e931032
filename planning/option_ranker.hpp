// Ranks ways to do a task (grasp points along a handle, say) by what the whole body's motion would
// cost over a long horizon: a fixed number of SQP iterations for each, warm-started from the option
// before it, so options should be ordered by likeness. An ordinary thread; no allocation after the
// constructor. Frame W, SI. Source: DESIGN.md, "Formulation of the MPC" (horizons).
#pragma once
#include <memory>
#include <span>

#include "mpc/slq_solver.hpp"

namespace wb {

struct RankerSettings {
  GridSettings grid{0.1, 1.0, 0.1, 10.0};
  int iterations = 20;  // of every option; the first gets `first_iterations`
  int first_iterations = 40;
  double tolerance =
      1e-5;  // of the feed-forward [unit of u]: an option that has settled ends early
};

class OptionRanker {
 public:
  // Reads the robot's mpc.yaml; the grid is the settings'.
  explicit OptionRanker(std::shared_ptr<const RobotModel> model, RankerSettings settings = {});

  // Cost of each option's best motion from x0 at t0, as far as it was found; infinite where the
  // solver found none. Returns the index of the cheapest. Sizes: x0 nx(), costs as options.
  int rank(const double* x0, TimeNs t0, std::span<const Reference> options,
           const DistanceField* field, std::span<double> costs) RT_SAFE;

  const OptimalControlProblem& problem() const { return *problem_; }

 private:
  RankerSettings settings_;
  std::shared_ptr<const OptimalControlProblem> problem_;
  SlqSolver solver_;
  Policy policy_;
  SolveReport report_;
};

}  // namespace wb
