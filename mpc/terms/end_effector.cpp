// End-effectors follow the poses of Reference::ee: 1/2 Qp |p - p_ref|^2 + 1/2 Qo |log(R_ref^T
// R)|^2, times the reference's scales. The orientation error is in the end-effector's frame; it is
// smooth up to half a turn, where it jumps. Source: Bloesch et al. 2016 (box-minus and its
// Jacobian).
#include <cmath>

#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// Rotation vector of R, by way of the quaternion so that it is accurate at small angles and near
// half a turn.
Eigen::Vector3d log_rotation(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q(R);
  const double sine = q.vec().norm();
  const double angle = 2.0 * std::atan2(q.w() < 0 ? -sine : sine, std::abs(q.w()));
  // angle / sine -> 2 / |w| where the angle vanishes; below 1e-8 the difference is far below
  // rounding.
  return (sine > 1e-8 ? angle / sine : 2.0 / q.w()) * q.vec();
}

// d log(R exp(w)) / dw at w = 0, for log(R) = e.
Eigen::Matrix3d log_jacobian(const Eigen::Vector3d& e) {
  const double angle2 = e.squaredNorm();
  const double half = 0.5 * std::sqrt(angle2);
  // (1 - h cot h) / (4 h^2) and its series, which is exact to 1e-12 below the switch.
  const double c = half < 1e-3 ? (1.0 + half * half / 15.0) / 12.0
                               : (1.0 - half * std::cos(half) / std::sin(half)) / angle2;
  const Eigen::Matrix3d E = skew(e);
  return Eigen::Matrix3d::Identity() + 0.5 * E + c * E * E;
}

class EndEffectorTerm final : public Term {
 public:
  EndEffectorTerm(int position_weight, int orientation_weight, ModelPtr model)
      : Term("end_effector", TermKind::kCost, TermScope::kStageAndTerminal),
        position_weight_(position_weight),
        orientation_weight_(orientation_weight),
        model_(std::move(model)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (int k = 0; k < model_->end_effectors(); ++k) {
      if (node.sample->ee[k].active) cost += follow(k, node, quadratic);
    }
    return cost;
  }

 private:
  double follow(int k, const Node& node, Quadratic* quadratic) const noexcept {
    const PoseSample& want = node.sample->ee[k];
    const EndEffectorReference& ee = node.reference->ee[k];
    const double qp = node.weights[position_weight_] * ee.position_scale;
    const double qo = node.weights[orientation_weight_] * ee.orientation_scale;
    const Eigen::Isometry3d X_WE = model_->X_WF(model_->end_effector(k), node.kinematics);
    const Eigen::Vector3d e_p = X_WE.translation() - want.p_WE;
    const Eigen::Vector3d e_o = log_rotation(want.R_WE.transpose() * X_WE.linear());
    if (quadratic) {
      Jacobian J;
      model_->frame_jacobian(model_->end_effector(k), node.kinematics, J);
      const Eigen::Matrix3d to_error = log_jacobian(e_o) * X_WE.linear().transpose();
      PointJacobian J_o(3, J.cols());
      for (int c = 0; c < J.cols(); ++c) J_o.col(c) = to_error * J.col(c).tail<3>();
      for (int c = 0; c < J.cols(); ++c) {
        const Eigen::Vector3d jp = qp * J.col(c).head<3>(), jo = qo * J_o.col(c);
        quadratic->q[c] += jp.dot(e_p) + jo.dot(e_o);
        for (int r = 0; r < J.cols(); ++r) {
          quadratic->Q(r, c) += jp.dot(J.col(r).head<3>()) + jo.dot(J_o.col(r));
        }
      }
    }
    return 0.5 * (qp * e_p.squaredNorm() + qo * e_o.squaredNorm());
  }

  int position_weight_, orientation_weight_;  // indices of weights
  ModelPtr model_;
};

}  // namespace

std::unique_ptr<Term> make_end_effector_term(const config::Section& section, const ModelPtr& model,
                                             WeightTable& weights) {
  const int position = weights.add(section, "end_effector", "position_pm2", config::kNonNegative);
  const int orientation =
      weights.add(section, "end_effector", "orientation_prad2", config::kNonNegative);
  section.finish();
  return std::make_unique<EndEffectorTerm>(position, orientation, model);
}

}  // namespace wb
