#include "drivers/sim/sensors.hpp"

#include <Eigen/Geometry>
#include <cmath>

#include "core/types/time.hpp"

namespace wb::sim {
namespace {

using Eigen::Map;
using Eigen::Vector3d;
using RowMatrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

int body_id(const mjModel& model, const std::string& link) {
  if (link.empty()) return -1;
  const int id = mj_name2id(&model, mjOBJ_BODY, link.c_str());
  if (id < 0)
    throw config::ConfigError("sim.yaml names '" + link + "', which is no link of the URDF");
  return id;
}

}  // namespace

Sensors::Sensors(const PluginConfig& config, const mjModel& model)
    : noise_(config.scene.noise),
      imu_body_(body_id(model, config.sim.imu)),
      wrench_body_(body_id(model, config.sim.wrench_link)),
      end_effector_body_(body_id(model, config.robot.end_effector)),
      has_gripper_(!config.robot.fingers.empty()),
      encoders_(config.seed, kEncoderStream),
      imu_(config.seed, kImuStream),
      wrench_(config.seed, kWrenchStream),
      gripper_(config.seed, kGripperStream) {}

void Sensors::take_forces(const mjModel& model, mjData& data) noexcept {
  mj_rnePostConstraint(&model, &data);
  if (imu_body_ >= 0) {
    double acceleration[6];  // rotation over translation, gravity's reaction included
    mj_objectAcceleration(&model, &data, mjOBJ_XBODY, imu_body_, acceleration, 1);
    std::copy_n(acceleration + 3, 3, acceleration_.begin());
  }
  if (wrench_body_ < 0) return;

  // cfrc_int: what the parent exerts on the hand, about the whole robot's centre of mass. The
  // sensor shows its reaction.
  const double* internal = data.cfrc_int + 6 * wrench_body_;
  const Map<const Vector3d> com(data.subtree_com + 3 * model.body_rootid[wrench_body_]);
  const Map<const Vector3d> p_E(data.xpos + 3 * end_effector_body_);
  const Map<const RowMatrix> R_E(data.xmat + 9 * end_effector_body_);
  const Vector3d force = -Map<const Vector3d>(internal + 3);
  const Vector3d torque = -Map<const Vector3d>(internal) + (com - p_E).cross(force);
  Map<Vector3d>(wrench_E_.data()) = R_E.transpose() * force;
  Map<Vector3d>(wrench_E_.data() + 3) = R_E.transpose() * torque;
}

void Sensors::take_state(const mjModel& model, const mjData& data, const Servos& servos,
                         TimeNs t_ns) noexcept {
  readings_.t_ns = t_ns;
  const std::vector<Drive>& drives = servos.drives();
  for (std::size_t i = 0; i < drives.size(); ++i) {
    auto& joint = readings_.joints[i];
    joint.position = data.qpos[drives[i].q] + noise_.encoder_rad * encoders_.gaussian();
    joint.velocity = data.qvel[drives[i].v] + noise_.encoder_radps * encoders_.gaussian();
    joint.effort = data.ctrl[drives[i].u] + noise_.effort_nm * encoders_.gaussian();
    joint.valid = 1;
  }
  double velocity[6] = {};
  if (imu_body_ >= 0) mj_objectVelocity(&model, &data, mjOBJ_XBODY, imu_body_, velocity, 1);
  const double walk = noise_.gyro_walk_radps * std::sqrt(to_seconds(kPeriodNs));
  for (int i = 0; i < 3; ++i) {
    gyro_bias_[i] += walk * imu_.gaussian();
    readings_.imu.gyro[i] = velocity[i] + gyro_bias_[i] + noise_.gyro_radps * imu_.gaussian();
    readings_.imu.acceleration[i] = acceleration_[i] + noise_.accelerometer_mps2 * imu_.gaussian();
    readings_.wrench.force[i] = wrench_E_[i] + noise_.wrench_n * wrench_.gaussian();
    readings_.wrench.torque[i] = wrench_E_[3 + i] + noise_.wrench_nm * wrench_.gaussian();
  }
  readings_.imu.valid = imu_body_ >= 0;
  readings_.wrench.valid = wrench_body_ >= 0;
  if (has_gripper_) {
    readings_.gripper.opening =
        servos.gripper_opening(data) + noise_.gripper_m * gripper_.gaussian();
    readings_.gripper.force = servos.gripper_force(data) + noise_.gripper_n * gripper_.gaussian();
    readings_.gripper.valid = 1;
  }
}

}  // namespace wb::sim
