// The fake driver plugin (fake_driver.h). FAKE_ABI, FAKE_SIZE: what its interface claims, for the
// tests of refusals.
#include "tests/drivers/fake/fake_driver.h"

#include <algorithm>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

#include "core/config/config.hpp"

#ifndef FAKE_ABI
#define FAKE_ABI WB_DRIVER_ABI
#endif
#ifndef FAKE_SIZE
#define FAKE_SIZE sizeof(wb_driver_api)
#endif

struct wb_driver {
  std::string extension;
  wb_description description{};
  wb_fake_script script{};
  std::vector<std::string> counter_names;
  std::vector<const char*> counter_texts;
  wb_diagnostics diagnostics{};
};

namespace {

template <std::size_t N>
void copy_name(char (&to)[N], const std::string& from) {
  std::strncpy(to, from.c_str(), N - 1);
}

std::vector<std::string> texts_or_none(const wb::config::Section& s, const std::string& key) {
  return s.has(key) ? s.texts(key) : std::vector<std::string>();
}

std::uint32_t mask(const std::vector<std::string>& kinds) {
  std::uint32_t out = 0;
  for (const std::string& k : kinds) {
    out |= k == "impedance"  ? 1u << WB_CMD_IMPEDANCE
           : k == "velocity" ? 1u << WB_CMD_VELOCITY
           : k == "position" ? 1u << WB_CMD_POSITION
           : k == "torque"   ? 1u << WB_CMD_TORQUE
                             : 0u;
  }
  return out;
}

void load(wb_driver& d, const char* config) {
  const auto s = wb::config::Section::parse(config, "fake driver");
  d.extension = "wb.fake/" + s.text("name");
  copy_name(d.description.name, s.text("name"));
  const std::vector<std::string> kinds =
      s.has("kinds") ? s.texts("kinds") : std::vector<std::string>{"impedance"};
  const double effort_max = s.number_or("effort_max", 10.0);
  const auto add = [&](const std::string& name, std::uint32_t command_kinds, bool wheel) {
    wb_joint_info& j = d.description.joints[d.description.joint_count];
    auto& r = d.script.readings.joints[d.description.joint_count];
    r.position = 0.1 * d.description.joint_count++;
    r.quality = 1.0;
    r.status = WB_JOINT_FOLLOWING;
    r.valid = 1;
    copy_name(j.name, name);
    j.velocity_max = 1.0;
    j.effort_max = effort_max;
    j.command_kinds = command_kinds;
    j.is_wheel = wheel;
  };
  for (const std::string& name : texts_or_none(s, "joints")) add(name, mask(kinds), false);
  const std::uint32_t wheel_kinds =
      s.has("wheel_kinds") ? mask(s.texts("wheel_kinds")) : 1u << WB_CMD_VELOCITY;
  for (const std::string& name : texts_or_none(s, "wheels")) add(name, wheel_kinds, true);
  for (const std::string& sensor : texts_or_none(s, "sensors")) {
    if (sensor == "imu") d.description.has_imu = d.script.readings.imu.valid = 1;
    if (sensor == "wrench") d.description.has_wrench = d.script.readings.wrench.valid = 1;
    if (sensor == "gripper") d.description.has_gripper = d.script.readings.gripper.valid = 1;
    if (sensor == "emergency_stop") d.description.has_emergency_stop = 1;
  }
  if (s.has("camera")) {
    const auto c = s.section("camera");
    d.description.camera_count = 1;
    copy_name(d.description.cameras[0].name, c.text("name"));
    d.description.cameras[0].width = static_cast<std::uint32_t>(c.integer("width"));
    d.description.cameras[0].height = static_cast<std::uint32_t>(c.integer("height"));
    c.finish();
  }
  d.counter_names = texts_or_none(s, "counters");
  for (const std::string& name : d.counter_names) d.counter_texts.push_back(name.c_str());
  d.diagnostics = {static_cast<std::uint32_t>(d.counter_texts.size()), d.counter_texts.data(),
                   [](const wb_driver* driver, std::uint64_t* values) {
                     std::copy_n(driver->script.counters, driver->counter_texts.size(), values);
                   }};
  s.finish();
}

wb_driver* create(const char* config, const char*, wb_log log, void* user) {
  auto* d = new wb_driver;
  try {
    load(*d, config);
    return d;
  } catch (const std::exception& error) {
    if (log) log(user, WB_LOG_ERROR, error.what());
    delete d;
    return nullptr;
  }
}

void destroy(wb_driver* d) { delete d; }
wb_status describe(const wb_driver* d, wb_description* out) {
  *out = d->description;
  return WB_OK;
}
wb_status configure(wb_driver* d) {
  d->script.state = WB_INACTIVE;
  return WB_OK;
}
wb_status activate(wb_driver* d, std::int64_t timeout_ns, const wb_timeout_action* actions) {
  if (d->script.activate != WB_OK) return d->script.activate;
  d->script.state = WB_ACTIVE;
  ++d->script.activations;
  d->script.timeout_ns = timeout_ns;
  std::copy_n(actions, d->description.joint_count, d->script.actions);
  return WB_OK;
}
wb_status deactivate(wb_driver* d) {
  if (d->script.state != WB_ACTIVE) return WB_BAD_STATE;
  d->script.state = WB_INACTIVE;
  ++d->script.deactivations;
  return WB_OK;
}
wb_status read(wb_driver* d, wb_readings* out) {
  if (d->script.read == WB_OK) *out = d->script.readings;
  return d->script.read;
}
wb_status write(wb_driver* d, const wb_commands* commands) {
  ++d->script.writes;
  d->script.commands = *commands;
  return d->script.write;
}
wb_status stop(wb_driver*) { return WB_OK; }
wb_status acquire_frame(wb_driver* d, wb_frame* out) {
  *out = {};
  if (d->script.frames_without_depth) {
    --d->script.frames_without_depth;
    return WB_OK;
  }
  if (!d->script.frames) return WB_NO_DATA;
  --d->script.frames;
  out->depth = d->script.depth;
  return WB_OK;
}
wb_status release_frame(wb_driver* d, std::uint64_t) {
  ++d->script.released;
  return WB_OK;
}
wb_status advance(wb_driver*, std::int64_t) { return WB_BAD_STATE; }
const void* get_extension(wb_driver* d, const char* name) {
  if (d->extension == name) return &d->script;
  if (!d->counter_names.empty() && std::strcmp(name, WB_DIAGNOSTICS) == 0) return &d->diagnostics;
  return nullptr;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry() {
  static const wb_driver_api api = {FAKE_ABI,      FAKE_SIZE, create,       destroy,
                                    describe,      configure, activate,     deactivate,
                                    read,          write,     stop,         acquire_frame,
                                    release_frame, advance,   get_extension};
  return &api;
}
