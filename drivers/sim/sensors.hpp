// What the robot's sensors say of the plant, 400 times a second of the plant's time, each with its
// own noise stream. Step world. Signs and frames: core/types/readings.hpp.
#pragma once
#include <mujoco/mujoco.h>

#include <array>

#include "drivers/driver.h"
#include "drivers/sim/random.hpp"
#include "drivers/sim/servos.hpp"

namespace wb::sim {

class Sensors {
 public:
  static constexpr TimeNs kPeriodNs = 2'500'000;

  Sensors(const PluginConfig& config, const mjModel& model);

  // What depends on accelerations and contact forces: call between the step's integration and the
  // next position stage, while MuJoCo's forces still belong to its positions.
  void take_forces(const mjModel& model, mjData& data) noexcept;
  // The rest of the sample, at the present state. t_ns is its stamp.
  void take_state(const mjModel& model, const mjData& data, const Servos& servos,
                  TimeNs t_ns) noexcept;

  const wb_readings& newest() const noexcept { return readings_; }

 private:
  NoiseConfig noise_;
  int imu_body_ = -1, wrench_body_ = -1;  // -1: no such sensor
  int end_effector_body_ = 0;
  bool has_gripper_ = false;
  Random encoders_, imu_, wrench_, gripper_;
  std::array<double, 3> gyro_bias_{};
  std::array<double, 3> acceleration_{};  // in the IMU's axes, without noise
  std::array<double, 6> wrench_E_{};      // force, torque, without noise
  wb_readings readings_{};
};

}  // namespace wb::sim
