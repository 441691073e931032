// How fast the inputs u = (base velocities; dq) may be and may change: URDF for the joints,
// robot.yaml for the base. Setup and step world. Units: m/s, rad/s; m/s^2, rad/s^2.
#pragma once
#include "mpc/term.hpp"

namespace wb {

struct InputLimits {
  InputVector velocity;
  InputVector acceleration;
};

inline InputLimits input_limits(const RobotModel& model) {
  InputLimits out;
  out.velocity.resize(model.nu());
  out.acceleration.resize(model.nu());
  const BaseConfig& base = model.config().base;
  int row = 0;
  for (; row < model.base_inputs(); ++row) {
    const bool turn = row + 1 == model.base_inputs();  // the last one
    out.velocity[row] = turn ? base.yaw_rate_max : base.velocity_max;
    out.acceleration[row] = turn ? base.yaw_acceleration_max : base.acceleration_max;
  }
  for (int j = 0; j < model.joints(); ++j, ++row) {
    out.velocity[row] = model.limits(j).velocity;
    out.acceleration[row] = model.limits(j).acceleration;
  }
  return out;
}

}  // namespace wb
