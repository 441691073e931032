#include "mpc/solve_report.hpp"

#include <cstdio>

namespace wb {

std::string_view to_string(SolveStatus status) {
  switch (status) {
    case SolveStatus::kConverging:
      return "converging";
    case SolveStatus::kNoStep:
      return "no step";
    case SolveStatus::kShortened:
      return "shortened";
    case SolveStatus::kNotFinite:
      return "not finite";
  }
  return "?";
}

namespace {

std::string state_name(const RobotModel& model, int row) {
  if (row < model.base_dof()) return row == 0 ? "base x" : row == 1 ? "base y" : "base yaw";
  return model.config().joints[row - model.base_dof()].name;
}

std::string input_name(const RobotModel& model, int row) {
  const int base = model.base_inputs();
  if (row >= base) return model.config().joints[row - base].name;
  return row + 1 == base ? "base yaw rate" : row == 0 ? "base velocity" : "base lateral velocity";
}

}  // namespace

std::string describe(const OptimalControlProblem& problem, const Trouble& trouble) {
  std::string at;
  if (trouble.node >= 0 && trouble.node < problem.nodes()) {
    char text[48];
    std::snprintf(text, sizeof text, " at node %d (%.2f s)", trouble.node,
                  problem.grid()[trouble.node]);
    at = text;
  }
  const auto term = [&] {
    const bool known =
        trouble.index >= 0 && trouble.index < static_cast<int>(problem.terms().size());
    return known ? problem.terms()[trouble.index]->name() : std::string("?");
  };
  switch (trouble.kind) {
    case TroubleKind::kNone:
      return "none";
    case TroubleKind::kState:
      return "state " + state_name(problem.model(), trouble.index) + " is not a number";
    case TroubleKind::kReference:
      return "reference is not a number" + at;
    case TroubleKind::kWeights:
      return "weights refused: " + (trouble.index >= 0
                                        ? problem.weights().infos()[trouble.index].name
                                        : std::string("wrong count"));
    case TroubleKind::kTerm:
      return "term " + term() + " is not a number" + at;
    case TroubleKind::kModel:
      return "motion is not a number" + at;
    case TroubleKind::kInput:
      return "not convex in " +
             (trouble.index >= 0 ? input_name(problem.model(), trouble.index)
                                 : std::string("an input")) +
             at;
    case TroubleKind::kDescent:
      return "no step: term " + term() + " rises";
  }
  return "?";
}

}  // namespace wb
