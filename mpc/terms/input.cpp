// Effort: 1/2 |u|^2_R with a diagonal R. Both axes of an omnidirectional base share a weight.
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class InputTerm final : public Term {
 public:
  explicit InputTerm(std::vector<int> weights)
      : Term("input", TermKind::kCost, TermScope::kStage), weights_(std::move(weights)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (std::size_t i = 0; i < weights_.size(); ++i) {
      const int r = static_cast<int>(i);
      const double weight = node.weights[weights_[i]];
      const double gradient = weight * node.u[r];
      cost += 0.5 * gradient * node.u[r];
      if (quadratic) {
        quadratic->r[r] += gradient;
        quadratic->R(r, r) += weight;
      }
    }
    return cost;
  }

 private:
  std::vector<int> weights_;  // index of each input's weight
};

}  // namespace

std::unique_ptr<Term> make_input_term(const config::Section& section, const ModelPtr& model,
                                      WeightTable& weights) {
  std::vector<int> indices;
  if (model->base_inputs() > 0) {
    const int translation = weights.add(section, "input", "base_velocity_s2pm2", config::kPositive);
    indices.resize(static_cast<std::size_t>(model->base_inputs()) - 1, translation);
    indices.push_back(weights.add(section, "input", "base_yaw_rate_s2prad2", config::kPositive));
  }
  const int first = weights.add_list(section, "input", "joint_velocity_s2prad2", model->joints(),
                                     config::kPositive);
  for (int j = 0; j < model->joints(); ++j) indices.push_back(first + j);
  section.finish();
  return std::make_unique<InputTerm>(indices);
}

}  // namespace wb
