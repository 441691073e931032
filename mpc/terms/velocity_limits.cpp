// Commanded rates stay below their limits: relaxed barrier on z = 1 -+ u / u_max, the distance to
// the limit as a fraction of it. The limits follow Reference::speed_scale. What the barrier lets
// through, the solver's box stops.
#include "mpc/input_limits.hpp"
#include "mpc/relaxed_barrier.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class VelocityLimitsTerm final : public Term {
 public:
  VelocityLimitsTerm(RelaxedBarrier barrier, InputVector limits)
      : Term("velocity_limits", TermKind::kSoftInequality, TermScope::kStage),
        barrier_(barrier),
        limits_(std::move(limits)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (int i = 0; i < limits_.size(); ++i) {
      const double per_limit = 1.0 / (limits_[i] * node.reference->speed_scale);
      const double u = node.u[i] * per_limit;
      node.violation = std::max(node.violation, std::abs(u) - 1.0);
      for (const double sign : {1.0, -1.0}) {
        const RelaxedBarrier::Value v = barrier_.at(1.0 - sign * u);
        cost += v.value;
        if (quadratic) {
          quadratic->r[i] -= sign * per_limit * v.slope;
          quadratic->R(i, i) += per_limit * per_limit * v.curvature;
        }
      }
    }
    return cost;
  }

 private:
  RelaxedBarrier barrier_;
  InputVector limits_;
};

}  // namespace

std::unique_ptr<Term> make_velocity_limits_term(const config::Section& section,
                                                const ModelPtr& model, WeightTable& weights) {
  RelaxedBarrier barrier;
  barrier.mu = section.number("mu", config::kPositive);
  barrier.reach = section.number("reach_fraction", {1e-6, 1.0});
  barrier.delta = section.number("delta_fraction", {1e-6, barrier.reach});
  section.finish();
  return std::make_unique<VelocityLimitsTerm>(barrier, input_limits(*model).velocity);
}

}  // namespace wb
