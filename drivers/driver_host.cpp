#include "drivers/driver_host.hpp"

#include <dlfcn.h>

#include <cstring>
#include <stdexcept>

namespace wb {
namespace {

void forward_log(void* user, wb_log_level level, const char* text) {
  const auto& log = *static_cast<DriverHost::Log*>(user);
  if (log) log(level, text);
}

}  // namespace

DriverHost::Plugin::~Plugin() {
  if (driver) api->destroy(driver);
  if (library) dlclose(library);
}

DriverHost::DriverHost(const RobotConfig& robot, const std::vector<PluginSpec>& specs, Log log)
    : log_(std::move(log)), robot_(robot) {
  for (const PluginSpec& spec : specs) {
    const std::string name = spec.library.string();
    plugins_.push_back(std::make_unique<Plugin>());
    Plugin& p = *plugins_.back();
    p.library = dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!p.library) throw std::runtime_error("driver " + name + " cannot be loaded: " + dlerror());
    const auto entry = reinterpret_cast<wb_driver_entry_fn>(dlsym(p.library, WB_DRIVER_ENTRY));
    if (!entry) throw std::runtime_error("driver " + name + " does not export " WB_DRIVER_ENTRY);
    p.api = entry();
    if (!p.api || p.api->abi != WB_DRIVER_ABI || p.api->size != sizeof(wb_driver_api)) {
      throw std::runtime_error("driver " + name + " has ABI " +
                               std::to_string(p.api ? p.api->abi : 0) + ", this program has " +
                               std::to_string(WB_DRIVER_ABI));
    }
    p.driver = p.api->create(spec.config.c_str(), spec.folder.c_str(), forward_log, &log_);
    if (!p.driver)
      throw std::runtime_error("driver " + name + " could not be created (its log lines say why)");
    if (p.api->configure(p.driver) != WB_OK)
      throw std::runtime_error("driver " + name + " could not be configured");
    if (p.api->describe(p.driver, &p.description) != WB_OK)
      throw std::runtime_error("driver " + name + " does not describe itself");
    for (std::uint32_t c = 0; c < p.description.camera_count; ++c) {
      int index = -1;
      for (std::size_t i = 0; i < robot.cameras.size(); ++i) {
        if (robot.cameras[i].name == p.description.cameras[c].name) index = static_cast<int>(i);
      }
      p.cameras.push_back(index);
    }
  }
  for (const JointConfig& j : robot.joints) joints_.push_back(find(j.name));
  for (const std::string& w : robot.base.wheels) wheels_.push_back(find(w));
}

DriverHost::~DriverHost() { deactivate(); }

DriverHost::Place DriverHost::find(const std::string& joint) const {
  Place place;
  for (std::size_t p = 0; p < plugins_.size(); ++p) {
    const wb_description& d = plugins_[p]->description;
    for (std::uint32_t j = 0; j < d.joint_count; ++j) {
      if (joint != d.joints[j].name) continue;
      if (place.plugin >= 0)
        throw std::runtime_error("joint " + joint + " of robot " + robot_.name +
                                 " has two drivers");
      place = {static_cast<int>(p), static_cast<int>(j)};
    }
  }
  if (place.plugin < 0)
    throw std::runtime_error("joint " + joint + " of robot " + robot_.name + " has no driver");
  return place;
}

bool DriverHost::activate(TimeNs command_timeout_ns) {
  if (active_) deactivate();
  for (auto& p : plugins_) {
    std::vector<wb_timeout_action> actions(WB_DRIVER_MAX_JOINTS, WB_TIMEOUT_HOLD);
    for (std::uint32_t j = 0; j < p->description.joint_count; ++j) {
      if (p->description.joints[j].is_wheel) actions[j] = WB_TIMEOUT_BRAKE;
    }
    if (p->api->activate(p->driver, command_timeout_ns, actions.data()) != WB_OK) {
      for (auto& q : plugins_) q->api->deactivate(q->driver);
      return false;
    }
  }
  active_ = true;
  return true;
}

void DriverHost::deactivate() {
  if (!active_) return;
  for (auto& p : plugins_) p->api->deactivate(p->driver);
  active_ = false;
}

void DriverHost::read(TimeNs now, Readings& r) RT_SAFE {
  r.t_ns = now;
  r.joint_count = static_cast<int>(joints_.size());
  r.wheel_count = static_cast<int>(wheels_.size());
  r.driver_fault = r.emergency_stop = r.imu_valid = r.wrench_valid = r.gripper_valid = false;
  for (auto& p : plugins_) {
    if (p->api->read(p->driver, &p->readings) != WB_OK) {
      r.driver_fault = true;
      for (auto& j : p->readings.joints) j.valid = 0;
      continue;
    }
    const wb_readings& in = p->readings;
    r.driver_fault = r.driver_fault || (active_ && in.timed_out);
    r.emergency_stop = r.emergency_stop || in.emergency_stop;
    if (in.imu.valid) {
      std::memcpy(r.gyro.data(), in.imu.gyro, sizeof in.imu.gyro);
      std::memcpy(r.acceleration.data(), in.imu.acceleration, sizeof in.imu.acceleration);
      r.imu_valid = true;
    }
    if (in.wrench.valid) {
      std::memcpy(r.wrench.data(), in.wrench.force, sizeof in.wrench.force);
      std::memcpy(r.wrench.data() + 3, in.wrench.torque, sizeof in.wrench.torque);
      r.wrench_valid = true;
    }
    if (in.gripper.valid) {
      r.gripper_opening_m = in.gripper.opening;
      r.gripper_force_n = in.gripper.force;
      r.gripper_valid = true;
    }
  }
  const auto take = [&](const Place& place, JointReading& out) {
    const auto& in = plugins_[place.plugin]->readings.joints[place.joint];
    out = {in.position, in.velocity, in.effort, in.age_ns, in.valid != 0};
  };
  for (std::size_t i = 0; i < joints_.size(); ++i) take(joints_[i], r.joints[i]);
  for (std::size_t i = 0; i < wheels_.size(); ++i) take(wheels_[i], r.wheels[i]);
}

void DriverHost::write(const SafeCommand& safe) RT_SAFE {
  if (!active_) return;
  const Command& c = safe.get();
  if (c.joint_count == 0) return;  // the empty command moves nothing
  const auto put = [&](const Place& place, const JointCommand& in) {
    auto& out = plugins_[place.plugin]->commands.joints[place.joint];
    out.kind = in.kind == CommandKind::kImpedance  ? WB_CMD_IMPEDANCE
               : in.kind == CommandKind::kVelocity ? WB_CMD_VELOCITY
                                                   : WB_CMD_NONE;
    out.position = in.position;
    out.velocity = in.velocity;
    out.effort = in.torque;
    out.stiffness = in.stiffness;
    out.damping = in.damping;
  };
  for (int i = 0; i < c.joint_count; ++i) put(joints_[i], c.joints[i]);
  for (int i = 0; i < c.wheel_count; ++i) put(wheels_[i], c.wheels[i]);
  for (auto& p : plugins_) {
    p->commands.t_ns = c.t_ns;
    p->commands.gripper.opening = c.gripper.opening_m;
    p->commands.gripper.force = c.gripper.force_n;
    // A refused write shows in the next reading (timed_out), which is where the controller looks.
    (void)p->api->write(p->driver, &p->commands);
  }
}

bool DriverHost::can_step() const {
  for (const auto& p : plugins_) {
    if (!p->description.can_step) return false;
  }
  return true;
}

void DriverHost::advance(TimeNs t) RT_SAFE {
  for (auto& p : plugins_) (void)p->api->advance(p->driver, t);
}

bool DriverHost::next_frame(DepthFrame& frame) {
  for (auto& p : plugins_) {
    wb_frame f;
    if (p->api->acquire_frame(p->driver, &f) != WB_OK) continue;
    const int camera = f.camera < p->cameras.size() ? p->cameras[f.camera] : -1;
    if (camera >= 0) {
      frame.camera = camera;
      frame.t_ns = f.t_ns;
      frame.intrinsics = robot_.cameras[camera].intrinsics;
      const std::size_t pixels =
          static_cast<std::size_t>(frame.intrinsics.width) * frame.intrinsics.height;
      frame.depth.assign(f.depth, f.depth + pixels);
      if (f.colour) {
        frame.colour.assign(f.colour, f.colour + 3 * pixels);
      } else {
        frame.colour.clear();
      }
    }
    p->api->release_frame(p->driver, f.token);
    if (camera >= 0) return true;
  }
  return false;
}

const void* DriverHost::extension(const char* name, wb_driver** driver) const {
  for (const auto& p : plugins_) {
    if (const void* e = p->api->get_extension ? p->api->get_extension(p->driver, name) : nullptr) {
      if (driver) *driver = p->driver;
      return e;
    }
  }
  return nullptr;
}

}  // namespace wb
