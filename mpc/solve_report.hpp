// What a solve did and, where something went wrong, what caused it. Fixed size: part of the MPC
// step's record. Written by SlqSolver in the MPC loop.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>

#include "mpc/optimal_control_problem.hpp"

namespace wb {

enum class SolveStatus : std::uint8_t {
  kConverging,  // a step was accepted
  kNoStep,      // the line search accepted nothing; the policy is the last one, shifted
  kShortened,   // a step was accepted on the part of the horizon where everything is a number
  kNotFinite,   // trouble from the start on; the policy is the last one, shifted
};
std::string_view to_string(SolveStatus status);

enum class TroubleKind : std::uint8_t {
  kNone,
  kState,      // x0: index is the row
  kReference,  // keyframes or speed scale are not numbers
  kWeights,    // outside what WeightTable accepts: the last good ones are used
  kTerm,       // its cost is not a number: index is the term
  kModel,      // the motion is not a number
  kInput,      // the quadratic problem is not convex
  kDescent,    // no step length lowers the cost: index is the term that rises most
};

struct Trouble {
  TroubleKind kind = TroubleKind::kNone;
  std::int16_t index = -1;
  std::int16_t node = -1;
};
// "term environment at node 12 (0.48 s)", "state SH_ROT", ... Ordinary threads: allocates.
std::string describe(const OptimalControlProblem& problem, const Trouble& trouble);

struct SolveReport {
  SolveStatus status = SolveStatus::kConverging;
  Trouble trouble;
  double cost_before = 0, cost_after = 0;  // of the warm start and of the result
  double defect = 0;        // largest dynamics defect of the result; 0, results are rolled out
  double equality = 0;      // largest |e| of the equalities on the result
  double step = 0;          // accepted step length, 0 if none
  double largest_move = 0;  // of the feed-forward: 0 at an optimum
  double regularisation = 0;
  int nodes = 0;  // of the result
  // Work done; bounded by grid, terms and SolverSettings (SlqSolver::work_bound).
  int node_evaluations = 0, term_evaluations = 0, factorisations = 0;
  TermValues terms;                    // of the result
  int active_environment_spheres = 0;  // spheres whose hinge is active on some node
  std::uint64_t weights_revision = 0;
};

// Since start.
struct SolverCounters {
  std::uint64_t solves = 0, no_step = 0, shortened = 0, kept = 0, regularised = 0,
                refused_weights = 0;
};

}  // namespace wb
