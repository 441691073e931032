#include "drivers/plant/simulated_robot.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>

// Of drivers/sim/plugin.cpp, which is part of this program.
extern "C" const wb_driver_api* wb_driver_entry();

namespace wb::plant {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr TimeNs kNever = std::numeric_limits<TimeNs>::max() / 4;

void keep_error(void* user, wb_log_level level, const char* text) {
  if (level >= WB_LOG_WARN) *static_cast<std::string*>(user) = text;
}

}  // namespace

SimulatedRobot::SimulatedRobot(const std::string& config, const std::filesystem::path& folder)
    : api_(wb_driver_entry()) {
  std::string error;
  driver_ = api_->create(config.c_str(), folder.c_str(), keep_error, &error);
  if (driver_ == nullptr) throw std::runtime_error("simulated robot: " + error);
  truth_ = static_cast<const wb_sim_truth*>(api_->get_extension(driver_, WB_SIM_TRUTH));
  api_->describe(driver_, &description_);
  api_->configure(driver_);
  const std::vector<wb_timeout_action> actions(WB_DRIVER_MAX_JOINTS, WB_TIMEOUT_HOLD);
  api_->activate(driver_, kNever, actions.data());
  targets_.resize(description_.joint_count);
  last_position_.assign(description_.joint_count, kNone);
  commands_.gripper = {driver_->plant.readings().gripper.opening, 0};
  api_->advance(driver_, 0);
}

SimulatedRobot::~SimulatedRobot() { api_->destroy(driver_); }

int SimulatedRobot::joint(const std::string& name) const {
  for (std::uint32_t i = 0; i < description_.joint_count; ++i) {
    if (name == description_.joints[i].name) return static_cast<int>(i);
  }
  return -1;
}

void SimulatedRobot::grip(double opening_m, double force_n) {
  commands_.gripper = {opening_m, force_n};
}

double SimulatedRobot::position(int joint) const {
  return driver_->plant.data().qpos[driver_->plant.servos().drives()[joint].q];
}
double SimulatedRobot::velocity(int joint) const {
  return driver_->plant.data().qvel[driver_->plant.servos().drives()[joint].v];
}

// A drive in position mode carries the load's weight by its integral part; here gravity and
// Coriolis torques stand for it. Its set-point's velocity is what the set-point itself does.
void SimulatedRobot::write() {
  const sim::Plant& plant = driver_->plant;
  const double step_s = to_seconds(plant.step_ns());
  for (std::size_t i = 0; i < targets_.size(); ++i) {
    const JointTarget& t = targets_[i];
    auto& out = commands_.joints[i];
    const bool wheel = description_.joints[i].is_wheel != 0;
    const double bias = wheel ? 0 : plant.data().qfrc_bias[plant.servos().drives()[i].v];
    double last = kNone;
    switch (t.kind) {
      case JointTarget::Kind::kBrake:
        out = {};
        break;
      case JointTarget::Kind::kPosition: {
        last = t.position;
        const double rate =
            std::isnan(last_position_[i]) ? 0 : (t.position - last_position_[i]) / step_s;
        const sim::JointSimConfig* gains = wheel ? nullptr : &driver_->config.sim.joints[i];
        const sim::WheelSimConfig& wheels = driver_->config.sim.wheels;
        out = {WB_CMD_IMPEDANCE,
               t.position,
               rate,
               bias,
               gains ? gains->hold_stiffness : wheels.brake_stiffness,
               gains ? gains->hold_damping : wheels.brake_damping};
        break;
      }
      case JointTarget::Kind::kVelocity:
        if (wheel) {
          out = {WB_CMD_VELOCITY, 0, t.velocity, 0, 0, 0};
        } else {
          out = {
              WB_CMD_IMPEDANCE, 0, t.velocity, bias, 0, driver_->config.sim.joints[i].hold_damping};
        }
        break;
      case JointTarget::Kind::kTorque:
        out = {WB_CMD_IMPEDANCE, 0, 0, t.torque, 0, 0};
        break;
      case JointTarget::Kind::kImpedance:
        out = {WB_CMD_IMPEDANCE, t.position, t.velocity, t.torque, t.stiffness, t.damping};
        break;
    }
    last_position_[i] = last;
  }
  commands_.t_ns = now();
  api_->write(driver_, &commands_);
}

void SimulatedRobot::advance(TimeNs t) {
  const TimeNs step = driver_->plant.step_ns();
  while (now() + step <= t) {
    write();
    if (api_->advance(driver_, now() + step) != WB_OK)
      throw std::runtime_error("the simulated robot has become unstable");
  }
}

wb_readings SimulatedRobot::readings() const {
  wb_readings out{};
  api_->read(driver_, &out);
  return out;
}

bool SimulatedRobot::next_frame(wb_frame& frame) {
  return api_->acquire_frame(driver_, &frame) == WB_OK;
}
void SimulatedRobot::release(const wb_frame& frame) { api_->release_frame(driver_, frame.token); }

}  // namespace wb::plant
