// Capsules of the robot keep a distance from each other: relaxed barrier on z = distance - minimum,
// per configured pair. The distance is FCL's between the capsules' axes less the radii: exact also
// where they penetrate, and it allocates nothing. Pairs whose bounding spheres are beyond the
// barrier's reach are culled.
#include <fcl/narrowphase/detail/primitive_shape_algorithm/capsule_capsule.h>

#include "mpc/relaxed_barrier.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

constexpr int kMaxCapsules = 64;

class SelfCollisionTerm final : public Term {
 public:
  SelfCollisionTerm(RelaxedBarrier barrier, double minimum, ModelPtr model)
      : Term("self_collision", TermKind::kSoftInequality, TermScope::kStageAndTerminal),
        barrier_(barrier),
        minimum_(minimum),
        model_(std::move(model)) {
    for (const auto& [a, b] : model_->self_pairs()) {
      Pair pair{a, b, barrier.reach + minimum};
      for (const int c : {a, b}) {
        const Capsule& capsule = model_->capsules()[c];
        pair.far += capsule.radius + 0.5 * (capsule.p1 - capsule.p0).norm();
      }
      pairs_.push_back(pair);
    }
    used_.resize(model_->capsules().size(), false);
    for (const Pair& pair : pairs_) used_[pair.a] = used_[pair.b] = true;
  }

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    struct Axis {
      Eigen::Vector3d p0, p1;
    };
    std::array<Axis, kMaxCapsules> axes;  // in W
    for (std::size_t c = 0; c < used_.size(); ++c) {
      if (!used_[c]) continue;
      const Capsule& capsule = model_->capsules()[c];
      const Eigen::Isometry3d& X_WL = node.kinematics.X_WL[capsule.body];
      axes[c] = {X_WL * capsule.p0, X_WL * capsule.p1};
    }
    double cost = 0;
    for (const Pair& pair : pairs_) {
      const Axis &a = axes[pair.a], &b = axes[pair.b];
      const double centres2 = 0.25 * (a.p0 + a.p1 - b.p0 - b.p1).squaredNorm();
      if (centres2 > pair.far * pair.far) continue;  // a NaN goes on into the cost
      const Capsule& first = model_->capsules()[pair.a];
      const Capsule& second = model_->capsules()[pair.b];
      double s = 0, t = 0;  // where along the axes the nearest points are
      Eigen::Vector3d nearest_a, nearest_b;
      const double distance = std::sqrt(fcl::detail::closestPtSegmentSegment<double>(
          a.p0, a.p1, b.p0, b.p1, &s, &t, &nearest_a, &nearest_b));
      const double z = distance - first.radius - second.radius - minimum_;
      node.violation = std::max(node.violation, -z);
      const RelaxedBarrier::Value v = barrier_.at(z);
      cost += v.value;
      // Axes that cross have no direction apart; the other pairs and the next nodes lead out.
      if (!quadratic || v.slope == 0.0 || distance < 1e-9) continue;
      const Eigen::Vector3d direction = (nearest_b - nearest_a) / distance;
      PointJacobian J_a, J_b;
      model_->point_jacobian(first.body, nearest_a, node.kinematics, J_a);
      model_->point_jacobian(second.body, nearest_b, node.kinematics, J_b);
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
  struct Pair {
    int a, b;
    double far;  // centres further apart than this are out of reach
  };

  RelaxedBarrier barrier_;
  double minimum_;
  ModelPtr model_;
  std::vector<Pair> pairs_;
  std::vector<bool> used_;
};

}  // namespace

std::unique_ptr<Term> make_self_collision_term(const config::Section& section,
                                               const ModelPtr& model, WeightTable&) {
  if (model->capsules().size() > kMaxCapsules) {
    throw config::ConfigError(model->config().folder.string() +
                              "/robot.yaml: 'collision_capsules' holds " +
                              std::to_string(model->capsules().size()) + ", allowed: at most " +
                              std::to_string(kMaxCapsules));
  }
  RelaxedBarrier barrier;
  barrier.mu = section.number("mu", config::kPositive);
  barrier.reach = section.number("reach_m", config::kPositive);
  barrier.delta = section.number("delta_m", {1e-6, barrier.reach});
  const double minimum = section.number("minimum_distance_m", config::kNonNegative);
  section.finish();
  return std::make_unique<SelfCollisionTerm>(barrier, minimum, model);
}

}  // namespace wb
