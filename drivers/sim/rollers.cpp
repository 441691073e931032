#include "drivers/sim/rollers.hpp"

#include <Eigen/Geometry>
#include <algorithm>

namespace wb::sim {
namespace {
using Eigen::Map;
using Eigen::Vector3d;
using RowMatrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
}  // namespace

Rollers::Rollers(const PluginConfig& config, const mjModel& model) {
  const BaseConfig& base = config.robot.base;
  if (base.kind != BaseKind::kOmnidirectional) return;
  base_body_ = mj_name2id(&model, mjOBJ_BODY, base.link.c_str());
  radius_m_ = base.wheel_radius_m;
  slip_nspm_ = config.sim.wheels.roller_slip_nspm;
  friction_ = config.sim.wheels.roller_friction;
  constexpr double kSideways[] = {-1, 1, 1, -1};  // front left, front right, rear left, rear right
  for (std::size_t i = 0; i < base.wheels.size(); ++i) {
    Wheel wheel;
    wheel.body = model.jnt_bodyid[mj_name2id(&model, mjOBJ_JOINT, base.wheels[i].c_str())];
    wheel.geom = model.body_geomadr[wheel.body];
    if (wheel.geom < 0)
      throw config::ConfigError(config.robot.urdf.string() + ": wheel " + base.wheels[i] +
                                " has no collision shape");
    wheel.sideways = kSideways[i];
    wheels_.push_back(wheel);
  }
}

void Rollers::take_loads(const mjModel& model, const mjData& data) noexcept {
  for (Wheel& wheel : wheels_) wheel.load_n = 0;
  for (int i = 0; i < data.ncon; ++i) {
    for (Wheel& wheel : wheels_) {
      if (data.contact[i].geom1 != wheel.geom && data.contact[i].geom2 != wheel.geom) continue;
      double force[6];  // normal first
      mj_contactForce(&model, &data, i, force);
      wheel.load_n += force[0];
    }
  }
}

void Rollers::apply(const mjModel& model, mjData& data) const noexcept {
  if (wheels_.empty()) return;
  mju_zero(data.qfrc_applied, model.nv);
  const Map<const RowMatrix> R_SB(data.xmat + 9 * base_body_);
  for (const Wheel& wheel : wheels_) {
    const Vector3d axis = (R_SB.col(0) + wheel.sideways * R_SB.col(1)).normalized();
    const Vector3d below = -radius_m_ * R_SB.col(2);
    double velocity[6];  // of the wheel's body in S's axes: rotation over translation
    mj_objectVelocity(&model, &data, mjOBJ_XBODY, wheel.body, velocity, 0);
    const Vector3d slip =
        Map<const Vector3d>(velocity + 3) + Map<const Vector3d>(velocity).cross(below);
    const double most = friction_ * wheel.load_n;
    const Vector3d force = std::clamp(-slip_nspm_ * slip.dot(axis), -most, most) * axis;
    const Vector3d point = Map<const Vector3d>(data.xpos + 3 * wheel.body) + below;
    const double torque[3] = {0, 0, 0};
    mj_applyFT(&model, &data, force.data(), torque, point.data(), wheel.body, data.qfrc_applied);
  }
}

}  // namespace wb::sim
