#include "drivers/driver_host.hpp"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace wb {
namespace {

void forward_log(void* user, wb_log_level level, const char* text) {
  const auto& log = *static_cast<DriverHost::Log*>(user);
  if (log) log(level, text);
}

JointStatus status_of(std::uint32_t status) {
  return status <= WB_JOINT_LOST ? static_cast<JointStatus>(status) : JointStatus::kUnknown;
}
static_assert(static_cast<int>(JointStatus::kUnknown) == WB_JOINT_UNKNOWN);
static_assert(static_cast<int>(JointStatus::kDisabled) == WB_JOINT_DISABLED);
static_assert(static_cast<int>(JointStatus::kFollowing) == WB_JOINT_FOLLOWING);
static_assert(static_cast<int>(JointStatus::kStopped) == WB_JOINT_STOPPED);
static_assert(static_cast<int>(JointStatus::kFault) == WB_JOINT_FAULT);
static_assert(static_cast<int>(JointStatus::kLost) == WB_JOINT_LOST);

}  // namespace

DriverHost::DriverHost(const RobotConfig& robot, const std::vector<PluginSpec>& specs, Log log)
    : log_(std::move(log)), robot_(robot) {
  for (std::size_t i = 0; i < specs.size(); ++i) {
    // Two plugins of one library: "can", "can_2".
    std::string name = Plugin::short_name(specs[i].library);
    const auto same = std::count_if(specs.begin(), specs.begin() + i, [&](const PluginSpec& s) {
      return Plugin::short_name(s.library) == name;
    });
    if (same > 0) name.append("_").append(std::to_string(same + 1));
    Instance& instance = instances_.emplace_back();
    instance.plugin = std::make_unique<Plugin>(specs[i], name, forward_log, &log_);
    const auto& counters = instance.plugin->counter_names();
    counter_names_.insert(counter_names_.end(), counters.begin(), counters.end());
    wanted_.push_back(specs[i].command);
    map_cameras(instance);
  }
  imu_ = provider("an IMU", &wb_description::has_imu);
  wrench_ = provider("a wrench sensor", &wb_description::has_wrench);
  gripper_ = provider("a gripper", &wb_description::has_gripper);
  provider("an emergency stop", &wb_description::has_emergency_stop);
  for (const JointConfig& j : robot.joints) joints_.push_back(find(j.name, false));
  for (const std::string& w : robot.base.wheels) wheels_.push_back(find(w, true));
}

DriverHost::~DriverHost() { deactivate(); }

void DriverHost::map_cameras(Instance& instance) {
  const wb_description& d = instance.plugin->description();
  for (std::uint32_t c = 0; c < d.camera_count; ++c) {
    int index = -1;
    for (std::size_t i = 0; i < robot_.cameras.size(); ++i) {
      if (robot_.cameras[i].name != d.cameras[c].name) continue;
      index = static_cast<int>(i);
      const CameraIntrinsics& k = robot_.cameras[i].intrinsics;
      const auto size = [](auto width, auto height) {
        return std::to_string(width) + " x " + std::to_string(height) + " pixels";
      };
      if (d.cameras[c].width != static_cast<std::uint32_t>(k.width) ||
          d.cameras[c].height != static_cast<std::uint32_t>(k.height))
        throw std::runtime_error("camera " + robot_.cameras[i].name + " of driver " +
                                 instance.plugin->name() + " has " +
                                 size(d.cameras[c].width, d.cameras[c].height) +
                                 ", in robot.yaml " + size(k.width, k.height));
    }
    instance.cameras.push_back(index);
  }
}

DriverHost::Place DriverHost::find(const std::string& joint, bool wheel) const {
  Place place;
  const std::string of = "joint " + joint + " of robot " + robot_.name;
  for (std::size_t p = 0; p < instances_.size(); ++p) {
    const wb_description& d = instances_[p].plugin->description();
    for (std::uint32_t j = 0; j < d.joint_count; ++j) {
      if (joint != d.joints[j].name) continue;
      if (place.instance >= 0)
        throw std::runtime_error(of +
                                 " has two drivers: " + instances_[place.instance].plugin->name() +
                                 " and " + instances_[p].plugin->name());
      place.instance = static_cast<int>(p);
      place.joint = static_cast<int>(j);
    }
  }
  if (place.instance < 0) throw std::runtime_error(of + " has no driver");
  place.adapter =
      CommandAdapter(instances_[place.instance].plugin->description().joints[place.joint], wheel,
                     wanted_[place.instance]);
  return place;
}

int DriverHost::provider(const char* what, std::uint32_t wb_description::*has) const {
  int found = -1;
  for (std::size_t p = 0; p < instances_.size(); ++p) {
    if (!(instances_[p].plugin->description().*has)) continue;
    if (found >= 0)
      throw std::runtime_error("robot " + robot_.name + " has two drivers with " + what + ": " +
                               instances_[found].plugin->name() + " and " +
                               instances_[p].plugin->name());
    found = static_cast<int>(p);
  }
  return found;
}

bool DriverHost::activate(TimeNs command_timeout_ns) {
  if (active_) deactivate();
  for (auto& instance : instances_) {
    const Plugin& p = *instance.plugin;
    std::vector<wb_timeout_action> actions(WB_DRIVER_MAX_JOINTS, WB_TIMEOUT_HOLD);
    for (std::uint32_t j = 0; j < p.description().joint_count; ++j) {
      if (p.description().joints[j].is_wheel) actions[j] = WB_TIMEOUT_BRAKE;
    }
    instance.commands = {};
    if (p.api().activate(p.get(), command_timeout_ns, actions.data()) != WB_OK) {
      if (log_) log_(WB_LOG_ERROR, "driver " + p.name() + " could not be activated");
      for (auto& other : instances_) other.plugin->api().deactivate(other.plugin->get());
      failed_ = true;
      return false;
    }
  }
  active_ = true;
  failed_ = false;
  return true;
}

void DriverHost::deactivate() {
  if (!active_) return;
  for (auto& instance : instances_) instance.plugin->api().deactivate(instance.plugin->get());
  active_ = false;
}

void DriverHost::read(TimeNs now, Readings& r) RT_SAFE {
  r.t_ns = now;
  r.joint_count = static_cast<int>(joints_.size());
  r.wheel_count = static_cast<int>(wheels_.size());
  r.emergency_stop = r.imu_valid = r.wrench_valid = r.gripper_valid = false;
  r.driver_fault = failed_;
  failed_ = false;
  for (std::size_t i = 0; i < instances_.size(); ++i) {
    Plugin& p = *instances_[i].plugin;
    wb_readings& in = instances_[i].readings;
    if (p.api().read(p.get(), &in) != WB_OK) {
      p.failed_reads.fetch_add(1, std::memory_order_relaxed);
      r.driver_fault = true;
      for (auto& j : in.joints) {
        j.valid = 0;
        j.status = WB_JOINT_UNKNOWN;
      }
      continue;
    }
    r.driver_fault = r.driver_fault || (active_ && in.timed_out);
    // Whoever says that it is pressed is believed, also one that did not describe an input.
    r.emergency_stop = r.emergency_stop || in.emergency_stop;
    const int self = static_cast<int>(i);
    if (self == imu_ && in.imu.valid) {
      std::memcpy(r.gyro.data(), in.imu.gyro, sizeof in.imu.gyro);
      std::memcpy(r.acceleration.data(), in.imu.acceleration, sizeof in.imu.acceleration);
      r.imu_valid = true;
    }
    if (self == wrench_ && in.wrench.valid) {
      std::memcpy(r.wrench.data(), in.wrench.force, sizeof in.wrench.force);
      std::memcpy(r.wrench.data() + 3, in.wrench.torque, sizeof in.wrench.torque);
      r.wrench_valid = true;
    }
    if (self == gripper_ && in.gripper.valid) {
      r.gripper_opening_m = in.gripper.opening;
      r.gripper_force_n = in.gripper.force;
      r.gripper_valid = true;
    }
  }
  for (std::size_t i = 0; i < joints_.size(); ++i)
    r.driver_fault = take(joints_[i], r.joints[i]) || r.driver_fault;
  for (std::size_t i = 0; i < wheels_.size(); ++i)
    r.driver_fault = take(wheels_[i], r.wheels[i]) || r.driver_fault;
}

// True: the joint cannot be trusted although its driver is active.
bool DriverHost::take(Place& place, JointReading& out) RT_SAFE {
  Instance& instance = instances_[place.instance];
  const auto& in = instance.readings.joints[place.joint];
  out.position = in.position;
  out.velocity = in.velocity;
  out.torque = in.effort;
  out.age_ns = in.age_ns;
  out.valid = in.valid != 0;
  out.status = status_of(in.status);
  out.error_code = in.error_code;
  out.quality = in.quality;
  place.reading = out;
  const bool fault =
      active_ && (out.status == JointStatus::kUnknown || out.status == JointStatus::kFault ||
                  out.status == JointStatus::kLost);
  if (fault) instance.plugin->joint_faults.fetch_add(1, std::memory_order_relaxed);
  return fault;
}

void DriverHost::write(const SafeCommand& safe) RT_SAFE {
  if (!active_) return;
  const Command& c = safe.get();
  if (c.joint_count == 0) return;  // the empty command moves nothing
  const auto put = [&](const Place& place, const JointCommand& in) {
    place.adapter.adapt(in, place.reading, instances_[place.instance].commands, place.joint);
  };
  for (int i = 0; i < c.joint_count; ++i) put(joints_[i], c.joints[i]);
  for (int i = 0; i < c.wheel_count; ++i) put(wheels_[i], c.wheels[i]);
  for (std::size_t i = 0; i < instances_.size(); ++i) {
    Plugin& p = *instances_[i].plugin;
    wb_commands& out = instances_[i].commands;
    out.t_ns = c.t_ns;
    if (static_cast<int>(i) == gripper_) {
      out.gripper.opening = c.gripper.opening_m;
      out.gripper.force = c.gripper.force_n;
    }
    if (p.api().write(p.get(), &out) != WB_OK) {
      p.failed_writes.fetch_add(1, std::memory_order_relaxed);
      failed_ = true;  // a driver fault in the next reading, which is where the controller looks
    }
  }
}

bool DriverHost::can_step() const {
  return std::all_of(instances_.begin(), instances_.end(),
                     [](const Instance& i) { return i.plugin->description().can_step != 0; });
}

void DriverHost::advance(TimeNs t) RT_SAFE {
  for (auto& instance : instances_) {
    const Plugin& p = *instance.plugin;
    if (p.description().can_step) (void)p.api().advance(p.get(), t);
  }
}

bool DriverHost::next_frame(DepthFrame& frame) {
  for (auto& instance : instances_) {
    const Plugin& p = *instance.plugin;
    wb_frame f;
    while (p.api().acquire_frame(p.get(), &f) == WB_OK) {
      const int camera = f.camera < instance.cameras.size() ? instance.cameras[f.camera] : -1;
      const bool wanted = camera >= 0 && f.depth;
      if (wanted) {
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
      p.api().release_frame(p.get(), f.token);
      if (wanted) return true;
    }
  }
  return false;
}

const void* DriverHost::extension(const char* name, wb_driver** driver) const {
  for (const auto& instance : instances_) {
    if (const void* e = instance.plugin->extension(name)) {
      if (driver) *driver = instance.plugin->get();
      return e;
    }
  }
  return nullptr;
}

void DriverHost::read_counters(std::uint64_t* values) const {
  for (const auto& instance : instances_) {
    instance.plugin->read_counters(values);
    values += instance.plugin->counter_names().size();
  }
}

}  // namespace wb
