// Which terms pull against each other along a policy: each term's gradient with respect to the
// whole input sequence, by one adjoint recursion a term, and the angles between them. World: jobs
// (allocates, some milliseconds). Unit: cost per root of seconds, inputs counted in fractions of
// their velocity limits, so that grids, joints and bases compare.
#pragma once
#include <string>
#include <vector>

#include "core/types/policy.hpp"
#include "core/types/weights.hpp"
#include "mpc/optimal_control_problem.hpp"

namespace wb {

struct TermPull {
  std::string name;
  double cost = 0;       // over the horizon
  double share = 0;      // of all terms' cost
  double violation = 0;  // largest, in the term's own unit; 0: none
  double pull = 0;       // norm of its gradient
};

struct Competition {
  std::string text;  // "end_effector pulls against environment (cosine -0.94): ..."
  int first = 0, second = 0;
  double cosine = 0;
};

struct Explanation {
  double cost = 0;
  std::vector<TermPull> terms;              // in the problem's order
  std::vector<std::vector<double>> cosine;  // 0 where a term does not pull at all
  std::vector<Competition> competing;       // the strongest opposition first
};

// Terms compete when the cosine of their gradients is below kOpposed and both gradients are at
// least kLarge of the largest one. Not compared are terms of the inputs alone (effort, velocity
// limits: they resist every motion), and costs that make up less than kSatisfied of all (such a
// term has what it wants, and merely balances a weaker one).
inline constexpr double kOpposed = -0.3, kLarge = 0.1, kSatisfied = 0.01;

// `reference` with the base's route, as the policy was solved for it. Throws std::invalid_argument
// if the policy is not of this problem's size, or empty.
Explanation explain(const OptimalControlProblem& problem, const Reference& reference,
                    const DistanceField* field, const Weights& weights, const Policy& policy);

}  // namespace wb
