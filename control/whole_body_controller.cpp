#include "control/whole_body_controller.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace wb {

WholeBodyController::WholeBodyController(std::shared_ptr<const RobotModel> model,
                                         const config::Section& section)
    : model_(std::move(model)),
      kinematics_(model_->config().base),
      stiffness_(section.numbers("stiffness_nmprad", model_->joints(), config::kNonNegative)),
      damping_(section.numbers("damping_nmsprad", model_->joints(), config::kNonNegative)) {
  admits_ = section.has("admittance");
  if (admits_) {
    const config::Section a = section.section("admittance");
    translation_damping_ = a.number("translation_damping_nspm", config::kPositive);
    rotation_damping_ = a.number("rotation_damping_nmsprad", config::kPositive);
    translation_max_ = a.number("translation_max_mps", config::kPositive);
    rotation_max_ = a.number("rotation_max_radps", config::kPositive);
    least_singular_ = a.number("least_singular_value", config::kPositive);
    a.finish();
  }
  section.finish();
}

void WholeBodyController::add_admittance(const WholeBodyInput& in, JointVector& dq) RT_SAFE {
  const RobotState& s = *in.state;
  const int base = model_->base_dof();
  StateVector x(model_->nx());
  for (int i = 0; i < base; ++i) x[i] = s.base[i];
  for (int i = 0; i < model_->joints(); ++i) x[base + i] = s.q[i];
  RobotModel::Data data;
  model_->forward_kinematics(x.data(), data);
  Jacobian J_WE;
  model_->frame_jacobian(model_->end_effector(), data, J_WE);
  const Eigen::Matrix3d R_WE = model_->X_WF(model_->end_effector(), data).linear();

  Eigen::Vector3d force_W = R_WE * Eigen::Vector3d(s.wrench[0], s.wrench[1], s.wrench[2]);
  const Eigen::Vector3d torque_W = R_WE * Eigen::Vector3d(s.wrench[3], s.wrench[4], s.wrench[5]);
  force_W -=
      in.free_direction_W * in.free_direction_W.dot(force_W);  // along the path the policy decides
  Eigen::Matrix<double, 6, 1> twist_W;
  twist_W << force_W / translation_damping_, torque_W / rotation_damping_;
  const double v = twist_W.head<3>().norm(), w = twist_W.tail<3>().norm();
  if (v > translation_max_) twist_W.head<3>() *= translation_max_ / v;
  if (w > rotation_max_) twist_W.tail<3>() *= rotation_max_ / w;

  const auto J_arm = J_WE.rightCols(model_->joints());
  Eigen::Matrix<double, 6, 6> A = J_arm * J_arm.transpose();
  A.diagonal().array() += least_singular_ * least_singular_;
  const Eigen::Matrix<double, 6, 1> y = A.ldlt().solve(twist_W);
  dq.noalias() += J_arm.transpose() * y;
}

void WholeBodyController::step(const WholeBodyInput& in, Command& out) RT_SAFE {
  const RobotState& s = *in.state;
  const int n = model_->joints(), base_dof = model_->base_dof(),
            base_inputs = model_->base_inputs();
  std::array<double, kMaxInputs> u{};
  if (in.policy && in.policy->states == model_->nx() && in.policy->inputs == model_->nu()) {
    std::array<double, kMaxStates> x{}, x_ref{};
    for (int i = 0; i < base_dof; ++i) x[i] = s.base[i];
    for (int i = 0; i < n; ++i) x[base_dof + i] = s.q_command[i];
    if (!in.policy->evaluate(s.t_ns, x.data(), u.data(), x_ref.data())) u.fill(0.0);
    for (double& rate : u) rate *= in.rate_scale;
  }
  JointVector dq(n);
  for (int i = 0; i < n; ++i) dq[i] = u[base_inputs + i];
  if (in.held && admits_) add_admittance(in, dq);

  JointVector gravity(n);
  model_->gravity(s.q.data(), gravity);
  out.t_ns = s.t_ns;
  out.joint_count = n;
  out.wheel_count = kinematics_.wheels();
  for (int i = 0; i < n; ++i) {
    JointCommand& j = out.joints[i];
    j.kind = CommandKind::kImpedance;
    j.position = s.q_command[i] + dq[i] * in.dt_s;
    j.velocity = dq[i];
    j.torque = gravity[i];
    j.stiffness = stiffness_[i];
    j.damping = damping_[i];
  }
  // u's base part is (v, w) or (vx, vy, w); without wheels the twist is not looked at.
  const WheelKinematics::Wheels speeds =
      kinematics_.wheel_speeds(base_inputs == 3 ? WheelKinematics::Twist{u[0], u[1], u[2]}
                                                : WheelKinematics::Twist{u[0], 0.0, u[1]});
  for (int i = 0; i < out.wheel_count; ++i) {
    out.wheels[i].kind = CommandKind::kVelocity;
    out.wheels[i].velocity = speeds[i];
  }
  out.gripper = in.gripper;
}

}  // namespace wb
