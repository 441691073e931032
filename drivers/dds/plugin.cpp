// libwb_driver_dds.so: the driver ABI over a robot's DDS topics. Worlds: create (waits for the
// robot), describe, configure, activate, deactivate, destroy are setup; read, write, stop, advance
// are ports and only touch the Exchange; advance (paced robots) waits for the tick, bounded.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <exception>

#include "drivers/dds/instance.hpp"

namespace wb::dds {
namespace {

void tell(const wb_driver* driver, wb_log_level level, const std::string& text) {
  if (driver->log != nullptr) driver->log(driver->log_user, level, text.c_str());
}

void read_counters(const wb_driver* driver, std::uint64_t* values) {
  for (std::size_t i = 0; i < Counters::size(); ++i) values[i] = driver->counters.value(i);
}

wb_driver* create(const char* config, const char*, wb_log log, void* log_user) {
  try {
    auto driver = std::make_unique<wb_driver>(DdsConfig::parse(config));
    driver->log = log;
    driver->log_user = log_user;
    driver->diagnostics = {Counters::size(), driver->counters.names(), read_counters};
    const wb_description& d = driver->link.description();
    tell(driver.get(), WB_LOG_INFO,
         std::string(d.name) + ": " + std::to_string(d.joint_count) + " joints, " +
             std::to_string(d.camera_count) + " cameras over DDS");
    return driver.release();
  } catch (const std::exception& error) {
    if (log != nullptr) log(log_user, WB_LOG_ERROR, error.what());
    return nullptr;
  }
}

void destroy(wb_driver* driver) { delete driver; }

wb_status describe(const wb_driver* driver, wb_description* out) {
  *out = driver->link.description();
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
  const std::string refusal = driver->link.activate(command_timeout_ns, actions);
  if (!refusal.empty()) {
    tell(driver, WB_LOG_ERROR, "driver dds: " + refusal);
    return WB_ERROR;
  }
  driver->state = WB_ACTIVE;
  return WB_OK;
}

wb_status deactivate(wb_driver* driver) {
  if (driver->state != WB_ACTIVE) return WB_BAD_STATE;
  driver->link.deactivate();
  driver->state = WB_INACTIVE;
  return WB_OK;
}

wb_status read(wb_driver* driver, wb_readings* out) {
  if (driver->state == WB_UNCONFIGURED) return WB_BAD_STATE;
  const DdsConfig& config = driver->config;
  Exchange& e = driver->exchange;
  const TimeNs now = e.now(), offset = e.stamp_offset();
  const auto age = [&](TimeNs stamp) { return std::max<TimeNs>(0, now + offset - stamp); };
  const std::uint32_t joints = driver->link.description().joint_count;
  *out = {};
  TimeNs newest = INT64_MIN;
  if (config.measurements()) {
    const Sample* s = e.measurements.read();
    if (s == nullptr) return WB_NO_DATA;
    const TimeNs sample_age = age(s->stamp_ns);
    if (sample_age > config.silence_ns) return WB_ERROR;
    newest = s->stamp_ns;
    for (std::uint32_t i = 0; i < joints; ++i) {
      out->joints[i] = s->readings.joints[i];
      out->joints[i].age_ns += sample_age;
      if (out->joints[i].age_ns > config.silence_ns) {
        out->joints[i].valid = 0;
        out->joints[i].status = WB_JOINT_LOST;
      }
    }
    if (config.imu == DdsConfig::kMeasurements) out->imu = s->readings.imu;
    if (config.wrench == DdsConfig::kMeasurements) out->wrench = s->readings.wrench;
    if (config.gripper) out->gripper = s->readings.gripper;
    out->emergency_stop = s->readings.emergency_stop;
  }
  if (const ImuSample* s = e.imu.read(); s && age(s->stamp_ns) <= config.silence_ns) {
    std::copy_n(s->gyro, 3, out->imu.gyro);
    std::copy_n(s->acceleration, 3, out->imu.acceleration);
    out->imu.valid = 1;
    newest = std::max(newest, s->stamp_ns);
  }
  if (const WrenchSample* s = e.wrench.read(); s && age(s->stamp_ns) <= config.silence_ns) {
    std::copy_n(s->force, 3, out->wrench.force);
    std::copy_n(s->torque, 3, out->wrench.torque);
    out->wrench.valid = 1;
    newest = std::max(newest, s->stamp_ns);
  }
  out->t_ns = newest == INT64_MIN ? now : newest - offset;
  if (!e.paced) e.watch();
  out->timed_out = driver->state == WB_ACTIVE && e.latched.load(std::memory_order_acquire);
  return WB_OK;
}

// Finite, and of kinds that the joints take. The low-level computer would refuse the others, too,
// but too late for whoever writes; and on the wire a kind has only eight bits.
bool proper(const wb_commands& c, const wb_description& description) {
  bool ok = std::isfinite(c.gripper.opening) && std::isfinite(c.gripper.force);
  for (std::uint32_t i = 0; i < description.joint_count; ++i) {
    const auto& j = c.joints[i];
    if (j.kind == WB_CMD_NONE) continue;
    ok = ok && j.kind <= WB_CMD_TORQUE &&
         (description.joints[i].command_kinds & (1u << j.kind)) != 0 && std::isfinite(j.position) &&
         std::isfinite(j.velocity) && std::isfinite(j.effort) && std::isfinite(j.stiffness) &&
         std::isfinite(j.damping);
  }
  return ok;
}

wb_status write(wb_driver* driver, const wb_commands* commands) {
  if (driver->state != WB_ACTIVE) return WB_BAD_STATE;
  Exchange& e = driver->exchange;
  e.watch();
  if (e.latched.load(std::memory_order_acquire)) return WB_TIMED_OUT;
  if (!proper(*commands, driver->link.description())) return WB_ERROR;
  Order& order = e.orders.writing();
  order.activation = e.activation.load(std::memory_order_relaxed);
  order.commands = *commands;
  order.commands.t_ns = e.now();
  e.orders.publish();
  e.last_write_ns.store(order.commands.t_ns, std::memory_order_release);
  // A paced robot's commands travel with the next tick.
  if (!e.paced) e.to_thread.ring();
  return WB_OK;
}

wb_status stop(wb_driver* driver) {
  if (driver->state != WB_ACTIVE) return WB_BAD_STATE;
  driver->exchange.latched.store(true, std::memory_order_release);
  driver->exchange.to_thread.ring();
  return WB_OK;
}

constexpr std::uint64_t kSlots = FrameRing::kSlots;

wb_status acquire_frame(wb_driver* driver, wb_frame* frame) {
  const std::size_t count = driver->config.cameras.size();
  for (std::size_t c = 0; c < count; ++c) {
    FrameRing& ring = driver->link.ring(c);
    const int slot = ring.acquire();
    if (slot < 0) continue;
    *frame = {};
    frame->camera = static_cast<std::uint32_t>(c);
    frame->t_ns = ring.t_ns(slot);
    frame->depth = ring.depth(slot);
    frame->token = c * kSlots + static_cast<std::uint64_t>(slot);
    return WB_OK;
  }
  return WB_NO_DATA;
}

wb_status release_frame(wb_driver* driver, std::uint64_t token) {
  if (token >= kSlots * driver->config.cameras.size()) return WB_ERROR;
  return driver->link.ring(token / kSlots).release(static_cast<int>(token % kSlots)) ? WB_OK
                                                                                     : WB_ERROR;
}

wb_status advance(wb_driver* driver, std::int64_t t_ns) {
  Exchange& e = driver->exchange;
  if (!e.paced || driver->state == WB_UNCONFIGURED || t_ns < 0) return WB_BAD_STATE;
  e.tick_t_ns.store(std::max(t_ns, e.now()), std::memory_order_relaxed);
  const std::uint64_t tick = e.tick_asked.load(std::memory_order_relaxed) + 1;
  e.tick_asked.store(tick, std::memory_order_release);
  e.to_thread.ring();
  const TimeNs end = clock_ns(CLOCK_MONOTONIC) + driver->config.tick_timeout_ns;
  bool answered = false;
  while (!(answered = e.tick_done.load(std::memory_order_acquire) >= tick)) {
    const TimeNs rest = end - clock_ns(CLOCK_MONOTONIC);
    if (rest <= 0) break;
    e.to_control.wait(rest);
  }
  // Not before: the robot stops in the midst of a tick, when the last command's time is up.
  e.watch();
  if (answered) return WB_OK;
  driver->counters.tick_unanswered();
  return WB_TIMED_OUT;
}

const void* get_extension(wb_driver* driver, const char* name) {
  if (std::strcmp(name, WB_DIAGNOSTICS) == 0) return &driver->diagnostics;
  if (std::strcmp(name, WB_SIM_TRUTH) == 0 && driver->config.truth) return truth_table();
  return nullptr;
}

}  // namespace
}  // namespace wb::dds

extern "C" __attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry() {
  using namespace wb::dds;
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
