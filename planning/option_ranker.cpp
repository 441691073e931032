#include "planning/option_ranker.hpp"

#include <limits>

namespace wb {

OptionRanker::OptionRanker(std::shared_ptr<const RobotModel> model, RankerSettings settings)
    : settings_(settings),
      problem_(std::make_shared<const OptimalControlProblem>(
          model, config::Section::open(model->config().folder / "mpc.yaml"),
          std::vector<std::string>{}, &settings_.grid)),
      solver_(problem_) {}

int OptionRanker::rank(const double* x0, TimeNs t0, std::span<const Reference> options,
                       const DistanceField* field, std::span<double> costs) RT_SAFE {
  solver_.reset();
  int best = -1;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < options.size(); ++i) {
    const int iterations = i == 0 ? settings_.first_iterations : settings_.iterations;
    (void)solver_.converge({.t0 = t0, .x0 = x0, .reference = &options[i], .field = field},
                           iterations, settings_.tolerance, policy_, report_);
    costs[i] =
        report_.status == SolveStatus::kNotFinite || report_.status == SolveStatus::kShortened
            ? std::numeric_limits<double>::infinity()
            : report_.cost_after;
    if (costs[i] < least) {
      least = costs[i];
      best = static_cast<int>(i);
    }
  }
  return best;
}

}  // namespace wb
