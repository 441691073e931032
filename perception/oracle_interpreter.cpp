#include "perception/oracle_interpreter.hpp"

#include <random>

#include "core/config/config.hpp"

namespace wb {
namespace {

// Everything of the object, carried from one frame into another (and there displaced by an error).
void transform(const Eigen::Isometry3d& X, const ObjectTruth& truth, ObjectPlan& plan) {
  const ArticulationEstimate& a = truth.articulation;
  plan.articulation = a;
  Eigen::Vector3d::Map(plan.articulation.axis_origin.data()) =
      X * Eigen::Vector3d::Map(a.axis_origin.data());
  Eigen::Vector3d::Map(plan.articulation.axis.data()) =
      X.linear() * Eigen::Vector3d::Map(a.axis.data());
  plan.X_WG = Pose::from(Eigen::Isometry3d(X * truth.X_SG));
  plan.handle_radius_m = truth.handle_radius_m;
  plan.handle_length_m = truth.handle_length_m;
  plan.masks = truth.masks;
  for (MaskBox& m : plan.masks) {
    m.X_WM = Pose::from(Eigen::Isometry3d(X * m.X_WM.isometry()));
    m.active = true;
  }
}

// Displaces by `translation` and turns by `yaw` about the vertical through `centre`.
Eigen::Isometry3d error_at(const Eigen::Vector3d& centre, const Eigen::Vector3d& translation,
                           double yaw) {
  return Eigen::Translation3d(centre + translation) *
         Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::Translation3d(-centre);
}

}  // namespace

OracleInterpreter::OracleInterpreter(std::shared_ptr<const RobotModel> model,
                                     const OracleOptions& options, TruthSource truth,
                                     const Eigen::Isometry3d& X_SW)
    : model_(std::move(model)), truth_(std::move(truth)), X_SW_(X_SW) {
  bool found = false;
  for (const CameraConfig& c : model_->config().cameras) {
    if (c.name != model_->config().shoulder_camera) continue;
    camera_ = c.intrinsics;
    camera_frame_ = model_->frame(c.name);
    found = true;
  }
  if (!found)
    throw config::ConfigError("robot " + model_->config().name + " has no camera '" +
                              model_->config().shoulder_camera + "'");
  std::mt19937_64 random(options.seed ^ 0x9e3779b97f4a7c15ull);
  std::normal_distribution<double> normal;
  const auto draw3 = [&](double sigma) {
    const double a = normal(random), b = normal(random), c = normal(random);
    return Eigen::Vector3d(sigma * a, sigma * b, sigma * c);
  };
  prior_translation_ = draw3(options.prior_m);
  prior_yaw_ = options.prior_rad * normal(random);
  measured_translation_ = draw3(options.measured_m);
  measured_yaw_ = options.measured_rad * normal(random);
}

bool OracleInterpreter::in_view(const Eigen::Isometry3d& X_CG) const {
  const Eigen::Vector3d p = X_CG.translation();
  if (p.z() < camera_.range_min_m || p.z() > camera_.range_max_m) return false;
  const double u = camera_.fx * p.x() / p.z() + camera_.cx,
               v = camera_.fy * p.y() / p.z() + camera_.cy;
  return u >= 0 && u < camera_.width && v >= 0 && v < camera_.height;
}

bool OracleInterpreter::interpret(const Name& object, const RobotState& state, ObjectPlan& plan) {
  ObjectTruth truth;
  if (!truth_(object, truth)) return false;
  plan.measured = state.phase == Phase::kPreGrasp && in_view(truth.X_SC.inverse() * truth.X_SG);
  if (plan.measured) {
    // Seen from the camera: the robot's own estimate of where its camera is carries the measurement
    // into W.
    StateVector x(model_->nx());
    for (int i = 0; i < model_->base_dof(); ++i) x[i] = state.base[i];
    for (int i = 0; i < model_->joints(); ++i) x[model_->base_dof() + i] = state.q[i];
    RobotModel::Data data;
    model_->forward_kinematics(x.data(), data);
    const Eigen::Isometry3d X_WS = model_->X_WF(camera_frame_, data) * truth.X_SC.inverse();
    const Eigen::Vector3d p_WG = X_WS * truth.X_SG.translation();
    transform(error_at(p_WG, measured_translation_, measured_yaw_) * X_WS, truth, plan);
  } else {
    const Eigen::Isometry3d X_WS = X_SW_.inverse();
    const Eigen::Vector3d p_WG = X_WS * truth.X_SG.translation();
    transform(error_at(p_WG, prior_translation_, prior_yaw_) * X_WS, truth, plan);
  }
  return true;
}

}  // namespace wb
