// Effort: 1/2 |u|^2_R with a diagonal R.
#include <Eigen/Core>

#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class InputTerm final : public Term {
 public:
  explicit InputTerm(InputVector weights)
      : Term("input", TermKind::kCost, TermScope::kStage), weights_(std::move(weights)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (int i = 0; i < weights_.size(); ++i) {
      const double gradient = weights_[i] * node.u[i];
      cost += 0.5 * gradient * node.u[i];
      if (quadratic) {
        quadratic->r[i] += gradient;
        quadratic->R(i, i) += weights_[i];
      }
    }
    return cost;
  }

 private:
  InputVector weights_;
};

}  // namespace

std::unique_ptr<Term> make_input_term(const config::Section& section, const ModelPtr& model) {
  InputVector weights(model->nu());
  int row = 0;
  if (model->base_inputs() > 0) {
    const double translation = section.number("base_velocity_s2pm2", config::kPositive);
    while (row + 1 < model->base_inputs()) weights[row++] = translation;
    weights[row++] = section.number("base_yaw_rate_s2prad2", config::kPositive);
  }
  for (const double w :
       section.numbers("joint_velocity_s2prad2", model->joints(), config::kPositive)) {
    weights[row++] = w;
  }
  section.finish();
  return std::make_unique<InputTerm>(weights);
}

}  // namespace wb
