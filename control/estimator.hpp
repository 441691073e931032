// State estimation: wheel-and-IMU odometry (a fixed base has none), joint states, wrench without
// the hand's weight (if there is a wrist sensor). Control loop, step world. Frames: W odometry (B's
// pose at start), B base, E hand. The yaw comes from the gyro, whose bias is learnt while the
// wheels stand still; the path length comes from the wheel encoders' positions, so that their noise
// does not add up.
#pragma once
#include <memory>

#include "core/config/config.hpp"
#include "core/model/robot_model.hpp"
#include "core/model/wheel_kinematics.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/readings.hpp"
#include "core/types/robot_state.hpp"

namespace wb {

class Estimator {
 public:
  // Keys of the section: gyro and still wheels with wheels, wrench_link with a wrist sensor.
  Estimator(std::shared_ptr<const RobotModel> model, const config::Section& section);

  // Fills t_ns, base, joints, wrench, IMU and gripper of `state`; the rest stays. Invalid readings
  // leave the last value.
  void step(const Readings& readings, RobotState& state) RT_SAFE;

 private:
  void step_base(const Readings& readings, double dt, bool imu, RobotState& state) RT_SAFE;

  std::shared_ptr<const RobotModel> model_;
  WheelKinematics kinematics_;
  double bias_time_constant_s_ = 0, still_wheel_speed_radps_ = 0, still_time_s_ = 0;
  double hand_mass_kg_ = 0;
  Eigen::Vector3d hand_com_E_{0, 0, 0};

  bool started_ = false, wheels_started_ = false;
  TimeNs last_t_ = 0;
  WheelKinematics::Wheels last_wheel_{};
  double gyro_bias_ = 0;
  double still_for_s_ = 0;
};

}  // namespace wb
