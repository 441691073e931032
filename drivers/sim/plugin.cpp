// libwb_driver_sim.so: the driver ABI over the simulated plant. The only non-test code of the
// project that links MuJoCo. Worlds: create, describe, configure, activate, deactivate, destroy are
// setup; read, write, stop, advance are ports. advance() steps the physics (about 0.1 ms for a tick
// of 2.5 ms) and renders due frames; inside it, MuJoCo's broad phase makes one qsort that
// allocates.
#include <algorithm>
#include <cstring>
#include <exception>
#include <string>

#include "drivers/sim/instance.hpp"

namespace wb::sim {
namespace {

// A stall of the host longer than this is left out of the plant's time when it runs in real time:
// advance() stays bounded.
constexpr TimeNs kCatchUpNs = 25'000'000;

template <std::size_t N>
void copy_name(char (&to)[N], const std::string& from) {
  std::strncpy(to, from.c_str(), N - 1);
  to[N - 1] = '\0';
}

wb_driver* create(const char* config, const char* folder, wb_log log, void* log_user) {
  try {
    auto driver = std::make_unique<wb_driver>(PluginConfig::parse(config, folder));
    const Eigen::Vector3d p = driver->plant.spawn_pose().translation();
    if (log != nullptr) {
      const std::string text = "simulated plant: scene " + driver->config.scene.name + ", robot " +
                               driver->config.robot.name + " at x " + std::to_string(p.x()) +
                               " m, y " + std::to_string(p.y()) + " m";
      log(log_user, WB_LOG_INFO, text.c_str());
    }
    return driver.release();
  } catch (const std::exception& error) {
    if (log != nullptr) log(log_user, WB_LOG_ERROR, error.what());
    return nullptr;
  }
}

void destroy(wb_driver* driver) { delete driver; }

wb_status describe(const wb_driver* driver, wb_description* out) {
  const RobotConfig& robot = driver->config.robot;
  const Servos& servos = driver->plant.servos();
  *out = {};
  copy_name(out->name, "sim:" + driver->config.scene.name + "/" + robot.name);
  for (const Drive& drive : servos.drives()) {
    const bool wheel = static_cast<int>(out->joint_count) >= servos.arm_joints();
    wb_joint_info& joint = out->joints[out->joint_count++];
    copy_name(joint.name, drive.name);
    joint.position_min = drive.lower;
    joint.position_max = drive.upper;
    joint.velocity_max = drive.velocity_max;
    joint.effort_max = drive.effort_max;
    joint.command_kinds = 1u << (wheel ? WB_CMD_VELOCITY : WB_CMD_IMPEDANCE);
    joint.is_wheel = wheel;
  }
  for (const CameraConfig& camera : robot.cameras) {
    wb_camera_info& info = out->cameras[out->camera_count++];
    copy_name(info.name, camera.name);
    const CameraIntrinsics& k = camera.intrinsics;
    info.width = static_cast<std::uint32_t>(k.width);
    info.height = static_cast<std::uint32_t>(k.height);
    info.fx = k.fx;
    info.fy = k.fy;
    info.cx = k.cx;
    info.cy = k.cy;
    info.range_min = k.range_min_m;
    info.range_max = k.range_max_m;
    info.rate = camera.rate_hz;
    info.has_colour = driver->config.colour;
  }
  out->has_emergency_stop = out->can_step = 1;
  out->has_imu = !driver->config.sim.imu.empty();
  out->has_wrench = !driver->config.sim.wrench_link.empty();
  out->has_gripper = !robot.fingers.empty();
  return WB_OK;
}

wb_status configure(wb_driver* driver) {
  if (driver->state != WB_UNCONFIGURED) return WB_BAD_STATE;
  driver->state = WB_INACTIVE;
  return WB_OK;
}

wb_status activate(wb_driver* driver, std::int64_t command_timeout_ns,
                   const wb_timeout_action* actions) {
  if (driver->state != WB_INACTIVE) return WB_BAD_STATE;
  if (command_timeout_ns <= 0 || actions == nullptr) return WB_ERROR;
  driver->plant.servos().activate(command_timeout_ns, actions);
  driver->state = WB_ACTIVE;
  return WB_OK;
}

wb_status deactivate(wb_driver* driver) {
  if (driver->state != WB_ACTIVE) return WB_BAD_STATE;
  driver->plant.servos().deactivate();
  driver->state = WB_INACTIVE;
  return WB_OK;
}

wb_status read(wb_driver* driver, wb_readings* out) {
  if (driver->state == WB_UNCONFIGURED) return WB_BAD_STATE;
  if (driver->faults.silent || !driver->plant.healthy()) return WB_ERROR;
  if (driver->faults.frozen) {
    *out = driver->frozen;
  } else {
    *out = driver->plant.readings();
    out->t_ns += driver->offset_ns;
  }
  const sim::Servos& servos = driver->plant.servos();
  const wb_joint_status status = servos.timed_out()   ? WB_JOINT_STOPPED
                                 : servos.following() ? WB_JOINT_FOLLOWING
                                                      : WB_JOINT_DISABLED;
  for (std::size_t i = 0; i < servos.drives().size(); ++i) {
    out->joints[i].age_ns = driver->now_ns() - out->t_ns;
    out->joints[i].quality = 1.0;
    out->joints[i].status = status;
  }
  out->emergency_stop = driver->faults.emergency_stop;
  out->timed_out = driver->plant.servos().timed_out();
  return WB_OK;
}

wb_status write(wb_driver* driver, const wb_commands* commands) {
  if (driver->faults.silent || !driver->plant.healthy()) return WB_ERROR;
  if (driver->faults.frozen)
    return driver->plant.servos().timed_out() ? WB_TIMED_OUT : WB_OK;  // lost
  return driver->plant.servos().write(*commands, driver->plant.time_ns());
}

wb_status stop(wb_driver* driver) {
  if (driver->state != WB_ACTIVE) return WB_BAD_STATE;
  driver->plant.servos().stop();
  return WB_OK;
}

wb_status acquire_frame(wb_driver* driver, wb_frame* frame) {
  return driver->cameras.acquire(*frame);
}
wb_status release_frame(wb_driver* driver, std::uint64_t token) {
  return driver->cameras.release(token);
}

wb_status advance(wb_driver* driver, std::int64_t t_ns) {
  if (driver->state == WB_UNCONFIGURED) return WB_BAD_STATE;
  const bool real_time = driver->config.render_thread;
  if (!driver->clock_started) {
    driver->clock_started = true;
    if (real_time) driver->offset_ns = t_ns;
    driver->cameras.expose(driver->plant, driver->offset_ns);
  }
  if (real_time) driver->offset_ns += std::max<TimeNs>(0, t_ns - driver->now_ns() - kCatchUpNs);
  while (driver->now_ns() + driver->plant.step_ns() <= t_ns) {
    driver->plant.step();
    driver->cameras.expose(driver->plant, driver->offset_ns);
  }
  return driver->plant.healthy() ? WB_OK : WB_ERROR;
}

const void* get_extension(wb_driver*, const char* name) { return find_extension(name); }

}  // namespace
}  // namespace wb::sim

extern "C" __attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry() {
  using namespace wb::sim;
  static const wb_driver_api api = {WB_DRIVER_ABI, sizeof(wb_driver_api),
                                    create,        destroy,
                                    describe,      configure,
                                    activate,      deactivate,
                                    read,          write,
                                    stop,          acquire_frame,
                                    release_frame, advance,
                                    get_extension};
  return &api;
}
