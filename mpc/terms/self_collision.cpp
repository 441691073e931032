// Capsules of the robot keep a distance from each other: relaxed barrier on z = distance - minimum,
// per configured pair. The distance is FCL's between the capsules' axes less the radii: exact also
// where they penetrate, and it allocates nothing. Beyond the barrier's reach a pair costs one
// distance query and no Jacobian.
#include <fcl/narrowphase/detail/primitive_shape_algorithm/capsule_capsule.h>

#include "mpc/relaxed_barrier.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class SelfCollisionTerm final : public Term {
 public:
  SelfCollisionTerm(RelaxedBarrier barrier, double minimum, ModelPtr model)
      : Term("self_collision", TermKind::kSoftInequality, TermScope::kStageAndTerminal),
        barrier_(barrier),
        minimum_(minimum),
        model_(std::move(model)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    double cost = 0;
    for (const auto& [first, second] : model_->self_pairs()) {
      const Capsule& a = model_->capsules()[first];
      const Capsule& b = model_->capsules()[second];
      const Eigen::Isometry3d& X_WA = node.kinematics.X_WL[a.body];
      const Eigen::Isometry3d& X_WB = node.kinematics.X_WL[b.body];
      double s = 0, t = 0;  // where along the axes the nearest points are
      Eigen::Vector3d nearest_a, nearest_b;
      const double axes = std::sqrt(fcl::detail::closestPtSegmentSegment<double>(
          X_WA * a.p0, X_WA * a.p1, X_WB * b.p0, X_WB * b.p1, &s, &t, &nearest_a, &nearest_b));
      const RelaxedBarrier::Value v = barrier_.at(axes - a.radius - b.radius - minimum_);
      cost += v.value;
      // Axes that cross have no direction apart; the other pairs and the next nodes lead out.
      if (!quadratic || v.slope == 0.0 || axes < 1e-9) continue;
      const Eigen::Vector3d direction = (nearest_b - nearest_a) / axes;
      PointJacobian J_a, J_b;
      model_->point_jacobian(a.body, nearest_a, node.kinematics, J_a);
      model_->point_jacobian(b.body, nearest_b, node.kinematics, J_b);
      StateVector gradient(node.x.size());
      for (int c = 0; c < gradient.size(); ++c)
        gradient[c] = direction.dot(J_b.col(c) - J_a.col(c));
      quadratic->q += v.slope * gradient;
      for (int c = 0; c < gradient.size(); ++c) {
        quadratic->Q.col(c) += v.curvature * gradient[c] * gradient;
      }
    }
    return cost;
  }

 private:
  RelaxedBarrier barrier_;
  double minimum_;
  ModelPtr model_;
};

}  // namespace

std::unique_ptr<Term> make_self_collision_term(const config::Section& section,
                                               const ModelPtr& model) {
  RelaxedBarrier barrier;
  barrier.mu = section.number("mu", config::kPositive);
  barrier.reach = section.number("reach_m", config::kPositive);
  barrier.delta = section.number("delta_m", {1e-6, barrier.reach});
  const double minimum = section.number("minimum_distance_m", config::kNonNegative);
  section.finish();
  return std::make_unique<SelfCollisionTerm>(barrier, minimum, model);
}

}  // namespace wb
