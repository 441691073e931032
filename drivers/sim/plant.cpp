#include "drivers/sim/plant.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>

#include "core/types/pose.hpp"

namespace wb::sim {
namespace {

constexpr TimeNs kSettleNs = 300'000'000;  // the robot sinks into its wheels' contacts within 0.2 s

// MuJoCo's own handler waits for a key. An error (its memory ran out) leaves nothing to go on with.
void on_error(const char* message) {
  std::fprintf(stderr, "simulated plant: MuJoCo: %s\n", message);
  std::abort();
}

// Warnings are counted in mjData; Plant::healthy reads them.
void on_warning(const char*) {}

// Uniform over the floor where the robot's bounding circle is clear of everything by 5 cm, with any
// heading.
Spawn draw_spawn(const PluginConfig& config, const mjData& data, Clearance& clearance) {
  constexpr double kMargin_m = 0.05;
  constexpr int kTries = 10'000;
  const double radius = config.robot.base.bounding_radius_m + kMargin_m;
  Random random(config.seed, kSpawnStream);
  for (int i = 0; i < kTries; ++i) {
    const auto draw = [&](const std::array<double, 2>& side) {
      return side[0] + radius + random.uniform() * (side[1] - side[0] - 2 * radius);
    };
    const double x = draw(config.scene.floor_x_m), y = draw(config.scene.floor_y_m);
    const double yaw = std::numbers::pi * (2 * random.uniform() - 1);
    if (clearance.column_is_free(data, x, y, radius)) return {x, y, yaw};
  }
  throw config::ConfigError("scene '" + config.scene.name + "' has no free floor for the robot");
}

}  // namespace

Plant::Plant(const PluginConfig& config) {
  mju_user_error = on_error;
  mju_user_warning = on_warning;
  model_ = compile(to_mjcf(config));
  data_.reset(mj_makeData(model_.get()));
  step_ns_ = config.sim.step_ns;
  base_body_ = body(config.robot.base.link);
  contacts_ = std::make_unique<ContactLog>(config, *model_);
  clearance_ = std::make_unique<Clearance>(*model_, *contacts_);
  place(config);
  servos_ = std::make_unique<Servos>(config, *model_, *data_);
  rollers_ = std::make_unique<Rollers>(config, *model_);
  sensors_ = std::make_unique<Sensors>(config, *model_);
  settle();
}

void Plant::place(const PluginConfig& config) {
  const auto coordinate = [&](const std::string& joint) {
    return data_->qpos + model_->jnt_qposadr[mj_name2id(model_.get(), mjOBJ_JOINT, joint.c_str())];
  };
  mj_forward(model_.get(), data_.get());
  const Spawn spawn = config.spawn ? *config.spawn : draw_spawn(config, *data_, *clearance_);
  const double pose[7] = {
      spawn.x_m, spawn.y_m, 0, std::cos(0.5 * spawn.yaw_rad), 0, 0, std::sin(0.5 * spawn.yaw_rad)};
  if (config.robot.base.kind == BaseKind::kFixed) {  // welded to the floor: a body without a joint
    std::copy_n(pose, 3, model_->body_pos + 3 * base_body_);
    std::copy_n(pose + 3, 4, model_->body_quat + 4 * base_body_);
  } else {
    std::copy_n(pose, 7, coordinate(config.robot.base.link));
  }
  for (std::size_t i = 0; i < config.robot.joints.size(); ++i)
    *coordinate(config.robot.joints[i].name) = config.posture[i];
  // Mimic joints start where their masters put them: MuJoCo's equality would have to throw them
  // there.
  for (int i = 0; i < model_->neq; ++i) {
    if (model_->eq_type[i] != mjEQ_JOINT) continue;
    const double* c = model_->eq_data + mjNEQDATA * i;
    data_->qpos[model_->jnt_qposadr[model_->eq_obj1id[i]]] =
        c[0] + c[1] * data_->qpos[model_->jnt_qposadr[model_->eq_obj2id[i]]];
  }
  for (const std::string& finger : config.robot.fingers)
    *coordinate(finger) = 0.5 * config.robot.gripper_opening_max_m;
  mj_forward(model_.get(), data_.get());
}

void Plant::settle() {
  for (TimeNs t = 0; t < kSettleNs; t += step_ns_) {
    servos_->apply(*data_, 0);
    rollers_->apply(*model_, *data_);
    mj_step2(model_.get(), data_.get());
    rollers_->take_loads(*model_, *data_);
    if (t + step_ns_ >= kSettleNs) sensors_->take_forces(*model_, *data_);
    mj_step1(model_.get(), data_.get());
  }
  sensors_->take_state(*model_, *data_, *servos_, 0);
  contacts_->scan(*data_, 0);
  const Eigen::Isometry3d X_SB = X_S(base_body_);
  X_SB0_ = planar_isometry(X_SB.translation().x(), X_SB.translation().y(),
                           std::atan2(X_SB(1, 0), X_SB(0, 0)));
}

void Plant::step() noexcept {
  servos_->apply(*data_, time_ns_);
  rollers_->apply(*model_, *data_);
  mj_step2(model_.get(), data_.get());
  rollers_->take_loads(*model_, *data_);
  time_ns_ += step_ns_;
  const bool sample = time_ns_ % Sensors::kPeriodNs == 0;
  if (sample) sensors_->take_forces(*model_, *data_);
  mj_step1(model_.get(), data_.get());
  if (sample) sensors_->take_state(*model_, *data_, *servos_, time_ns_);
  contacts_->scan(*data_, time_ns_);
}

bool Plant::healthy() const noexcept {
  return data_->warning[mjWARN_BADQPOS].number == 0 && data_->warning[mjWARN_BADQVEL].number == 0 &&
         data_->warning[mjWARN_BADQACC].number == 0;
}

Eigen::Isometry3d Plant::X_S(int body) const noexcept {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.linear() =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(data_->xmat + 9 * body);
  X.translation() = Eigen::Map<const Eigen::Vector3d>(data_->xpos + 3 * body);
  return X;
}

void Plant::set_part(int joint, double value) noexcept {
  data_->qpos[model_->jnt_qposadr[joint]] = value;
  data_->qvel[model_->jnt_dofadr[joint]] = 0;
  mj_forward(model_.get(), data_.get());
}

void Plant::push(int body, const double force[3], const double torque[3]) noexcept {
  std::copy_n(force, 3, data_->xfrc_applied + 6 * body);
  std::copy_n(torque, 3, data_->xfrc_applied + 6 * body + 3);
}

}  // namespace wb::sim
