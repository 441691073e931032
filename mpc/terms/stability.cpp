// The whole robot's centre of mass stays over a circle on the floor that B carries, so that a heavy
// arm cannot tip a light base: relaxed barrier on z = (r^2 - |d|^2) / (2 r) - margin, d the offset
// of the centre of mass from the circle's centre. Near the edge z is the distance to it; unlike
// that distance it is smooth in the middle. Source: Pankert and Hutter 2020 (static stability).
#include "mpc/relaxed_barrier.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class StabilityTerm final : public Term {
 public:
  StabilityTerm(RelaxedBarrier barrier, Eigen::Vector2d centre_B, double radius, double margin,
                ModelPtr model)
      : Term("stability", TermKind::kSoftInequality, TermScope::kStageAndTerminal),
        barrier_(barrier),
        centre_B_(centre_B),
        radius_(radius),
        margin_(margin),
        model_(std::move(model)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    const RobotModel::Data& data = node.kinematics;
    RobotModel::Subtrees subtrees;
    model_->subtrees(data, subtrees);
    const Eigen::Vector3d p_B =
        data.X_WL[0].linear().transpose() * (subtrees.com_W[0] - data.X_WL[0].translation());
    const Eigen::Vector2d d = p_B.head<2>() - centre_B_;
    const double z = 0.5 * (radius_ - d.squaredNorm() / radius_) - margin_;
    node.violation = std::max(node.violation, -z);
    const RelaxedBarrier::Value v = barrier_.at(z);
    if (!quadratic || v.slope == 0.0) return v.value;
    // dz = -d . dd / r; the base's own motion moves circle and robot alike.
    const Eigen::Vector3d slope_W =
        data.X_WL[0].linear() * Eigen::Vector3d(-d.x() / radius_, -d.y() / radius_, 0);
    StateVector gradient = StateVector::Zero(model_->nx());
    for (int i = 1; i < model_->bodies(); ++i) {
      const Eigen::Vector3d axis = model_->ratio(i) * data.axis_W[i];
      const Eigen::Vector3d motion =
          model_->prismatic(i)
              ? axis
              : Eigen::Vector3d(axis.cross(subtrees.com_W[i] - data.X_WL[i].translation()));
      gradient[model_->base_dof() + model_->joint_of(i)] +=
          subtrees.mass[i] / subtrees.mass[0] * slope_W.dot(motion);
    }
    quadratic->q += v.slope * gradient;
    for (int c = 0; c < gradient.size(); ++c)
      quadratic->Q.col(c) += v.curvature * gradient[c] * gradient;
    return v.value;
  }

 private:
  RelaxedBarrier barrier_;
  Eigen::Vector2d centre_B_;
  double radius_, margin_;
  ModelPtr model_;
};

}  // namespace

std::unique_ptr<Term> make_stability_term(const config::Section& section, const ModelPtr& model,
                                          WeightTable&) {
  RelaxedBarrier barrier;
  barrier.mu = section.number("mu", config::kPositive);
  barrier.reach = section.number("reach_m", config::kPositive);
  barrier.delta = section.number("delta_m", {1e-6, barrier.reach});
  const std::vector<double> centre = section.numbers("support_centre_m", 2);
  const double radius = section.number("support_radius_m", config::kPositive);
  const double margin = section.number("margin_m", config::kNonNegative);
  section.finish();
  return std::make_unique<StabilityTerm>(barrier, Eigen::Vector2d(centre[0], centre[1]), radius,
                                         margin, model);
}

}  // namespace wb
