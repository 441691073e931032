// The base follows Reference::base: 1/2 |position error|^2 and 1/2 (yaw error)^2, times base_scale.
// Yaw is continuous from the robot's present one on, so its error is not wrapped: a plan that has
// turned the wrong way by more than half a turn must be pulled back, not further round.
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class BaseRouteTerm final : public Term {
 public:
  BaseRouteTerm(int position_weight, int yaw_weight)
      : Term("base_route", TermKind::kCost, TermScope::kStageAndTerminal),
        position_weight_(position_weight),
        yaw_weight_(yaw_weight) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    if (!node.sample->has_base) return 0.0;
    const Eigen::Vector3d error = node.x.head<3>() - node.sample->base;
    const double position = node.reference->base_scale * node.weights[position_weight_];
    const Eigen::Vector3d weights(position, position,
                                  node.reference->base_scale * node.weights[yaw_weight_]);
    if (quadratic) {
      quadratic->q.head<3>() += weights.cwiseProduct(error);
      quadratic->Q.diagonal().head<3>() += weights;
    }
    return 0.5 * error.dot(weights.cwiseProduct(error));
  }

 private:
  int position_weight_, yaw_weight_;  // indices of weights
};

// A fixed base follows nothing; the name stays registered so that every robot has the same list.
class NoBaseRouteTerm final : public Term {
 public:
  NoBaseRouteTerm() : Term("base_route", TermKind::kCost, TermScope::kStageAndTerminal) {}
  double evaluate(Node&, Quadratic*) const noexcept override { return 0.0; }
};

}  // namespace

std::unique_ptr<Term> make_base_route_term(const config::Section& section, const ModelPtr& model,
                                           WeightTable& weights) {
  if (model->base_dof() == 0) {
    section.finish();
    return std::make_unique<NoBaseRouteTerm>();
  }
  const int position = weights.add(section, "base_route", "position_pm2", config::kNonNegative);
  const int yaw = weights.add(section, "base_route", "yaw_prad2", config::kNonNegative);
  section.finish();
  return std::make_unique<BaseRouteTerm>(position, yaw);
}

}  // namespace wb
