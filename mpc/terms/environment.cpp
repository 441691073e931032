// The robot's spheres keep clear of the mapped obstacles: mu / 2 min(0, z - delta)^2 with z = d(p)
// - radius - margin, d the distance field in W. Masked spheres may enter the unit being opened:
// they ignore the field where a mask box explains it, that is, where the box is no further away
// than the nearest obstacle, give or take a voxel's diagonal, which is as well as the map knows
// where a surface is.
#include <numbers>

#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

bool explained_by_a_mask(const Reference& reference, const Eigen::Vector3d& p_W, double distance,
                         double voxel) {
  for (const MaskBox& mask : reference.masks) {
    if (!mask.active) continue;
    const Eigen::Vector3d p_M =
        mask.X_WM.rotation().conjugate() * Eigen::Vector3d(p_W - mask.X_WM.position());
    const Eigen::Array3d half(mask.half_extent[0], mask.half_extent[1], mask.half_extent[2]);
    const double to_box = (p_M.array().abs() - half).max(0.0).matrix().norm();
    if (to_box == 0.0 || to_box <= distance + std::numbers::sqrt3 * voxel) return true;
  }
  return false;
}

class EnvironmentTerm final : public Term {
 public:
  EnvironmentTerm(double mu, double delta, double margin, ModelPtr model)
      : Term("environment", TermKind::kSoftInequality, TermScope::kStageAndTerminal),
        mu_(mu),
        delta_(delta),
        margin_(margin),
        model_(std::move(model)) {}

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    if (!node.field || node.field->empty()) return 0.0;
    double cost = 0;
    const std::vector<Sphere>& spheres = model_->spheres();
    for (std::size_t i = 0; i < spheres.size(); ++i) {
      const Sphere& sphere = spheres[i];
      const Eigen::Vector3d p_W = node.kinematics.X_WL[sphere.body] * sphere.centre;
      const double distance = node.field->distance(p_W);
      const double short_of = distance - sphere.radius - margin_ - delta_;
      if (short_of >= 0.0) continue;  // a NaN goes on into the cost
      if (sphere.masked &&
          explained_by_a_mask(*node.reference, p_W, distance, node.field->resolution())) {
        continue;
      }
      cost += 0.5 * mu_ * short_of * short_of;
      node.violation = std::max(node.violation, -(short_of + delta_ + margin_));
      node.active_spheres |= std::uint64_t{1} << i;
      if (!quadratic) continue;
      Eigen::Vector3d slope;
      node.field->distance(p_W, &slope);
      PointJacobian J;
      model_->point_jacobian(sphere.body, p_W, node.kinematics, J);
      StateVector gradient(node.x.size());
      for (int c = 0; c < gradient.size(); ++c) gradient[c] = slope.dot(J.col(c));
      quadratic->q += mu_ * short_of * gradient;
      for (int c = 0; c < gradient.size(); ++c) {
        quadratic->Q.col(c) += mu_ * gradient[c] * gradient;
      }
    }
    return cost;
  }

 private:
  double mu_, delta_, margin_;
  ModelPtr model_;
};

}  // namespace

std::unique_ptr<Term> make_environment_term(const config::Section& section, const ModelPtr& model,
                                            WeightTable& weights) {
  if (model->spheres().size() > kMaxSpheres) {
    throw config::ConfigError(model->config().folder.string() +
                              "/robot.yaml: 'collision_spheres' holds " +
                              std::to_string(model->spheres().size()) + ", allowed: at most " +
                              std::to_string(kMaxSpheres));
  }
  const double mu = section.number("mu_pm2", config::kPositive);
  const double delta = section.number("delta_m", config::kNonNegative);
  const double margin = section.number("margin_m", config::kNonNegative);
  section.finish();
  return std::make_unique<EnvironmentTerm>(mu, delta, margin, model);
}

}  // namespace wb
