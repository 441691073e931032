// How fast the inputs u = (v, w; dq) may be and may change: URDF for the joints, robot.yaml for the
// base. Setup and step world. Units: m/s, rad/s; m/s^2, rad/s^2.
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
  int row = 0;
  if (model.base_dof() > 0) {
    const BaseConfig& base = model.config().base;
    out.velocity.head<2>() << base.velocity_max, base.yaw_rate_max;
    out.acceleration.head<2>() << base.acceleration_max, base.yaw_acceleration_max;
    row = 2;
  }
  for (int j = 0; j < model.joints(); ++j, ++row) {
    out.velocity[row] = model.limits(j).velocity;
    out.acceleration[row] = model.limits(j).acceleration;
  }
  return out;
}

}  // namespace wb
