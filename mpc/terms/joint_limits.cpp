// Joints stay within their limits: relaxed barrier on the distance [rad] to each limit, less a
// margin.
#include "mpc/relaxed_barrier.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class JointLimitsTerm final : public Term {
 public:
  JointLimitsTerm(RelaxedBarrier barrier, double margin, ModelPtr model)
      : Term("joint_limits", TermKind::kSoftInequality, TermScope::kStageAndTerminal),
        barrier_(barrier),
        margin_(margin),
        model_(std::move(model)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (int j = 0; j < model_->joints(); ++j) {
      const int row = model_->base_dof() + j;
      const JointLimits& limits = model_->limits(j);
      const double above = node.x[row] - limits.lower, below = limits.upper - node.x[row];
      node.violation = std::max(node.violation, -std::min(above, below));
      const RelaxedBarrier::Value low = barrier_.at(above - margin_);
      const RelaxedBarrier::Value high = barrier_.at(below - margin_);
      cost += low.value + high.value;
      if (quadratic) {
        quadratic->q[row] += low.slope - high.slope;
        quadratic->Q(row, row) += low.curvature + high.curvature;
      }
    }
    return cost;
  }

 private:
  RelaxedBarrier barrier_;
  double margin_;
  ModelPtr model_;
};

}  // namespace

std::unique_ptr<Term> make_joint_limits_term(const config::Section& section, const ModelPtr& model,
                                             WeightTable& weights) {
  RelaxedBarrier barrier;
  barrier.mu = section.number("mu", config::kPositive);
  barrier.reach = section.number("reach_rad", config::kPositive);
  barrier.delta = section.number("delta_rad", {1e-6, barrier.reach});
  const double margin = section.number("margin_rad", config::kNonNegative);
  section.finish();
  return std::make_unique<JointLimitsTerm>(barrier, margin, model);
}

}  // namespace wb
