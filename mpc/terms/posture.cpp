// The arm stays near Reference::posture: 1/2 |q - q_ref|^2 with a weight per joint, times
// posture_scale.
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class PostureTerm final : public Term {
 public:
  PostureTerm(int first_weight, int joints, int first_row)
      : Term("posture", TermKind::kCost, TermScope::kStageAndTerminal),
        first_weight_(first_weight),
        joints_(joints),
        first_row_(first_row) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    if (node.reference->joint_count != joints_) return 0.0;
    double cost = 0;
    for (int j = 0; j < joints_; ++j) {
      const int row = first_row_ + j;
      const double weight = node.weights[first_weight_ + j] * node.reference->posture_scale;
      const double error = node.x[row] - node.reference->posture[j];
      cost += 0.5 * weight * error * error;
      if (quadratic) {
        quadratic->q[row] += weight * error;
        quadratic->Q(row, row) += weight;
      }
    }
    return cost;
  }

 private:
  int first_weight_, joints_, first_row_;
};

}  // namespace

std::unique_ptr<Term> make_posture_term(const config::Section& section, const ModelPtr& model,
                                        WeightTable& weights) {
  const int first = weights.add_list(section, "posture", "joint_position_prad2", model->joints(),
                                     config::kNonNegative);
  section.finish();
  return std::make_unique<PostureTerm>(first, model->joints(), model->base_dof());
}

}  // namespace wb
