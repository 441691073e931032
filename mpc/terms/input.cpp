// Effort: 1/2 |u|^2_R with a diagonal R.
#include <Eigen/Core>

#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class InputTerm final : public Term {
 public:
  InputTerm(int first_weight, int inputs)
      : Term("input", TermKind::kCost, TermScope::kStage), first_weight_(first_weight), inputs_(inputs) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (int i = 0; i < inputs_; ++i) {
      const double weight = node.weights[first_weight_ + i];
      const double gradient = weight * node.u[i];
      cost += 0.5 * gradient * node.u[i];
      if (quadratic) {
        quadratic->r[i] += gradient;
        quadratic->R(i, i) += weight;
      }
    }
    return cost;
  }

 private:
  int first_weight_, inputs_;  // the weights stand in a row
};

}  // namespace

std::unique_ptr<Term> make_input_term(const config::Section& section, const ModelPtr& model, WeightTable& weights) {
  const int first = static_cast<int>(weights.infos().size());
  if (model->base_dof() > 0) {
    weights.add(section, "input", "base_velocity_s2pm2", config::kPositive);
    weights.add(section, "input", "base_yaw_rate_s2prad2", config::kPositive);
  }
  weights.add_list(section, "input", "joint_velocity_s2prad2", model->joints(), config::kPositive);
  section.finish();
  return std::make_unique<InputTerm>(first, model->nu());
}

}  // namespace wb
