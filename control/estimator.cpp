#include "control/estimator.hpp"

#include <cmath>

namespace wb {
namespace {
constexpr double kGravity = 9.81;  // m/s^2

template <std::size_t N>
bool finite(const std::array<double, N>& values) {
  bool all = true;
  for (const double v : values) all = all && std::isfinite(v);
  return all;
}

bool usable(const JointReading& r) {
  return r.valid && std::isfinite(r.position) && std::isfinite(r.velocity) &&
         std::isfinite(r.torque);
}
}  // namespace

Estimator::Estimator(std::shared_ptr<const RobotModel> model, const config::Section& section)
    : model_(std::move(model)), kinematics_(model_->config().base) {
  if (kinematics_.wheels() > 0) {
    bias_time_constant_s_ = section.number("gyro_bias_time_constant_s", config::kPositive);
    still_wheel_speed_radps_ = section.number("still_wheel_speed_radps", config::kPositive);
    still_time_s_ = section.number("still_time_s", config::kPositive);
  }
  if (!section.has("wrench_link")) {
    section.finish();
    return;
  }
  const int sensor = model_->frame(section.text("wrench_link"));
  section.finish();
  hand_mass_kg_ = model_->mass_beyond(sensor, hand_com_E_);
  const StateVector x = StateVector::Zero(model_->nx());
  RobotModel::Data data;
  model_->forward_kinematics(x.data(), data);
  hand_com_E_ = model_->X_WF(model_->end_effector(), data).inverse() * model_->X_WF(sensor, data) *
                hand_com_E_;
}

void Estimator::step_base(const Readings& r, double dt, bool imu, RobotState& s) RT_SAFE {
  const int wheels = kinematics_.wheels();
  WheelKinematics::Wheels angle{}, moved{}, speed{};
  bool still = true;
  for (int i = 0; i < wheels; ++i) {
    if (!usable(r.wheels[i])) return;
    angle[i] = r.wheels[i].position;
    moved[i] = wheels_started_ ? angle[i] - last_wheel_[i] : 0.0;
    speed[i] = r.wheels[i].velocity;
    still = still && std::abs(speed[i]) < still_wheel_speed_radps_;
  }
  if (wheels == 0) return;
  wheels_started_ = true;
  last_wheel_ = angle;
  still_for_s_ = still ? still_for_s_ + dt : 0.0;
  const WheelKinematics::Twist way = kinematics_.twist(moved);
  double dyaw = way[2];
  s.base_velocity = kinematics_.twist(speed);
  if (imu) {
    if (still_for_s_ > still_time_s_)
      gyro_bias_ += dt / bias_time_constant_s_ * (r.gyro[2] - gyro_bias_);
    dyaw = (r.gyro[2] - gyro_bias_) * dt;
    s.base_velocity[2] = r.gyro[2] - gyro_bias_;
  }
  const double heading = s.base[2] + 0.5 * dyaw;  // midpoint rule
  s.base[0] += way[0] * std::cos(heading) - way[1] * std::sin(heading);
  s.base[1] += way[0] * std::sin(heading) + way[1] * std::cos(heading);
  s.base[2] += dyaw;
}

void Estimator::step(const Readings& r, RobotState& s) RT_SAFE {
  const double dt = started_ ? to_seconds(r.t_ns - last_t_) : 0.0;
  s.t_ns = r.t_ns;
  s.joint_count = r.joint_count;
  for (int i = 0; i < r.joint_count; ++i) {
    if (!usable(r.joints[i])) continue;
    s.q[i] = r.joints[i].position;
    s.dq[i] = r.joints[i].velocity;
    s.tau[i] = r.joints[i].torque;
  }

  const bool imu = r.imu_valid && finite(r.gyro) && finite(r.acceleration);
  step_base(r, dt, imu, s);
  if (imu) {
    s.gyro = r.gyro;
    s.acceleration = r.acceleration;
  }
  if (r.gripper_valid && std::isfinite(r.gripper_opening_m) && std::isfinite(r.gripper_force_n)) {
    s.gripper_opening_m = r.gripper_opening_m;
    s.gripper_force_n = r.gripper_force_n;
  }
  if (r.wrench_valid && finite(r.wrench)) {
    RobotModel::Data data;
    StateVector x(model_->nx());
    for (int i = 0; i < model_->base_dof(); ++i) x[i] = s.base[i];
    for (int i = 0; i < model_->joints(); ++i) x[model_->base_dof() + i] = s.q[i];
    model_->forward_kinematics(x.data(), data);
    const Eigen::Matrix3d R_WE = model_->X_WF(model_->end_effector(), data).linear();
    const Eigen::Vector3d weight_E =
        R_WE.transpose() * Eigen::Vector3d(0, 0, -hand_mass_kg_ * kGravity);
    const Eigen::Vector3d moment_E = hand_com_E_.cross(weight_E);
    for (int i = 0; i < 3; ++i) {
      s.wrench[i] = r.wrench[i] - weight_E[i];
      s.wrench[3 + i] = r.wrench[3 + i] - moment_E[i];
    }
  }
  started_ = true;
  last_t_ = r.t_ns;
}

}  // namespace wb
