#include "perception/keyframe_generator.hpp"

namespace wb {

static_assert(KeyframeGenerator::kKeyframes <= kMaxKeyframes);

Eigen::Isometry3d KeyframeGenerator::pose_at(const ArticulationEstimate& a,
                                             const Eigen::Isometry3d& X_WE0, double value) {
  const Eigen::Vector3d axis = Eigen::Vector3d::Map(a.axis.data()),
                        origin = Eigen::Vector3d::Map(a.axis_origin.data());
  const double change = value - a.value;
  if (a.kind == JointKind::kPrismatic) return Eigen::Translation3d(change * axis) * X_WE0;
  return Eigen::Translation3d(origin) * Eigen::AngleAxisd(change, axis) *
         Eigen::Translation3d(-origin) * X_WE0;
}

void KeyframeGenerator::generate(ObjectPlan& plan) const {
  Eigen::Isometry3d X_WE0 = plan.X_WG.isometry();
  if (X_WE0.linear().col(0).dot(x_E_W_) < 0)
    X_WE0.rotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitZ()));
  plan.keyframe_count = kKeyframes;
  for (int i = 0; i < kKeyframes; ++i) {
    const double s = static_cast<double>(i) / (kKeyframes - 1);
    plan.keyframe_value[i] =
        plan.articulation.value + s * (plan.articulation.range - plan.articulation.value);
    plan.keyframes[i] = Pose::from(pose_at(plan.articulation, X_WE0, plan.keyframe_value[i]));
  }
}

}  // namespace wb
