#include "core/model/import/inverse_kinematics.hpp"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace wb {
namespace {

using Eigen::Vector3d;
constexpr double kDamping = 0.02;
constexpr double kStep_rad = 0.3;  // at most, of any joint and iteration

double segment_distance(const Vector3d& p0, const Vector3d& p1, const Vector3d& q0,
                        const Vector3d& q1) {  // Ericson 2005, Real-Time Collision Detection, 5.1.9
  const Vector3d d1 = p1 - p0, d2 = q1 - q0, r = p0 - q0;
  const double a = d1.squaredNorm(), e = d2.squaredNorm(), f = d2.dot(r);
  constexpr double kPoint = 1e-12;
  double s = 0, t = 0;
  if (a <= kPoint && e <= kPoint) return r.norm();
  if (a <= kPoint) {
    t = std::clamp(f / e, 0.0, 1.0);
  } else {
    const double c = d1.dot(r);
    if (e <= kPoint) {
      s = std::clamp(-c / a, 0.0, 1.0);
    } else {
      const double b = d1.dot(d2), denominator = a * e - b * b;
      if (denominator > kPoint) s = std::clamp((b * f - c * e) / denominator, 0.0, 1.0);
      t = (b * s + f) / e;
      if (t < 0) {
        t = 0;
        s = std::clamp(-c / a, 0.0, 1.0);
      } else if (t > 1) {
        t = 1;
        s = std::clamp((b - c) / a, 0.0, 1.0);
      }
    }
  }
  return (r + s * d1 - t * d2).norm();
}

}  // namespace

ArmRange arm_range(const RobotModel& model) {
  ArmRange out;
  for (int j = 0; j < model.joints(); ++j) {
    const JointLimits& l = model.limits(j);
    const bool bounded = std::isfinite(l.lower) && std::isfinite(l.upper) && l.lower < l.upper;
    out.lower.push_back(bounded ? l.lower : -std::numbers::pi);
    out.upper.push_back(bounded ? l.upper : std::numbers::pi);
  }
  return out;
}

RobotModel::Data arm_data(const RobotModel& model, const std::vector<double>& q) {
  StateVector x = StateVector::Zero(model.nx());
  std::copy(q.begin(), q.end(), x.data() + model.base_dof());
  RobotModel::Data data;
  model.forward_kinematics(x.data(), data);
  return data;
}

IkResult solve_ik(const RobotModel& model, const ArmRange& range, const Eigen::Isometry3d& X_BE,
                  std::vector<double> q, int iterations) {
  IkResult out;
  const int n = model.joints();
  for (int i = 0;; ++i) {
    const RobotModel::Data data = arm_data(model, q);
    const Eigen::Isometry3d X = model.X_WF(model.end_effector(), data);
    const Eigen::AngleAxisd turn(X_BE.linear() * X.linear().transpose());
    Eigen::Matrix<double, 6, 1> error;
    error << X_BE.translation() - X.translation(), turn.angle() * turn.axis();
    out.position_error_m = error.head<3>().norm();
    out.angle_error_rad = error.tail<3>().norm();
    if (i == iterations || (out.position_error_m < 1e-5 && out.angle_error_rad < 1e-5)) break;
    Jacobian J;
    model.frame_jacobian(model.end_effector(), data, J);
    Eigen::MatrixXd J_arm = J.rightCols(n);
    // A joint at its limit that would go beyond does not take part.
    const Eigen::VectorXd wish = J_arm.transpose() * error;
    for (int j = 0; j < n; ++j) {
      if ((q[j] <= range.lower[j] && wish[j] < 0) || (q[j] >= range.upper[j] && wish[j] > 0))
        J_arm.col(j).setZero();
    }
    const Eigen::Matrix<double, 6, 6> A =
        J_arm * J_arm.transpose() + kDamping * kDamping * Eigen::Matrix<double, 6, 6>::Identity();
    Eigen::VectorXd dq = J_arm.transpose() * A.ldlt().solve(error);
    dq *= std::min(1.0, kStep_rad / std::max(1e-9, dq.cwiseAbs().maxCoeff()));
    for (int j = 0; j < n; ++j) q[j] = std::clamp(q[j] + dq[j], range.lower[j], range.upper[j]);
  }
  out.q = std::move(q);
  return out;
}

double least_singular_value(const RobotModel& model, const std::vector<double>& q,
                            double length_m) {
  Jacobian J;
  model.frame_jacobian(model.end_effector(), arm_data(model, q), J);
  Eigen::MatrixXd J_arm = J.rightCols(model.joints());
  J_arm.topRows(3) /= length_m;
  return Eigen::JacobiSVD<Eigen::MatrixXd>(J_arm).singularValues().tail<1>()[0];
}

double capsule_distance(const RobotModel::Data& data, const Capsule& a, const Capsule& b) {
  const Eigen::Isometry3d &X_WA = data.X_WL[a.body], &X_WB = data.X_WL[b.body];
  return segment_distance(X_WA * a.p0, X_WA * a.p1, X_WB * b.p0, X_WB * b.p1) - a.radius - b.radius;
}

double pair_distance(const RobotModel& model, const RobotModel::Data& data) {
  double nearest = 1e9;
  for (const auto& [a, b] : model.self_pairs())
    nearest = std::min(nearest, capsule_distance(data, model.capsules()[a], model.capsules()[b]));
  return nearest;
}

}  // namespace wb
