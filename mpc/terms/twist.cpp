// An end-effector moves at Reference::ee[k].twist_W: 1/2 |V - V_ref|^2 with a weight for the linear
// and one for the angular part. Couples x with u.
#include "mpc/terms/body_twist.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class TwistTerm final : public Term {
 public:
  TwistTerm(int linear, int angular, ModelPtr model)
      : Term("twist", TermKind::kCost, TermScope::kStage),
        linear_(linear),
        angular_(angular),
        model_(std::move(model)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (int k = 0; k < model_->end_effectors(); ++k) {
      const EndEffectorReference& ee = node.reference->ee[k];
      if (!ee.twist_active) continue;
      BodyTwist twist;
      body_twist(*model_, model_->end_effector(k), node.kinematics, node.x, node.u,
                 quadratic != nullptr, twist);
      Eigen::Matrix<double, 6, 1> weights;
      weights << Eigen::Vector3d::Constant(node.weights[linear_]),
          Eigen::Vector3d::Constant(node.weights[angular_]);
      const Eigen::Matrix<double, 6, 1> error =
          twist.V - Eigen::Map<const Eigen::Matrix<double, 6, 1>>(ee.twist_W.data());
      const Eigen::Matrix<double, 6, 1> slope = weights.cwiseProduct(error);
      cost += 0.5 * error.dot(slope);
      if (!quadratic) continue;
      const BodyTwist::InputJacobian W_u = weights.asDiagonal() * twist.V_u;
      const Jacobian W_x = weights.asDiagonal() * twist.V_x;
      quadratic->couple();
      quadratic->q.noalias() += twist.V_x.transpose().lazyProduct(slope);
      quadratic->r.noalias() += twist.V_u.transpose().lazyProduct(slope);
      quadratic->Q.noalias() += twist.V_x.transpose().lazyProduct(W_x);
      quadratic->R.noalias() += twist.V_u.transpose().lazyProduct(W_u);
      quadratic->P.noalias() += twist.V_u.transpose().lazyProduct(W_x);
    }
    return cost;
  }

 private:
  int linear_, angular_;  // indices of weights
  ModelPtr model_;
};

}  // namespace

std::unique_ptr<Term> make_twist_term(const config::Section& section, const ModelPtr& model,
                                      WeightTable& weights) {
  const int linear = weights.add(section, "twist", "linear_s2pm2", config::kNonNegative);
  const int angular = weights.add(section, "twist", "angular_s2prad2", config::kNonNegative);
  section.finish();
  return std::make_unique<TwistTerm>(linear, angular, model);
}

}  // namespace wb
