#include <cmath>
#include <cstring>
#include <iterator>
#include <set>

#include "drivers/check/checks.hpp"

namespace wb::check {
namespace {

std::string interface(const Options& options) {
  const Library library(options.library);
  const wb_driver_api* api = library.entry();
  if (!api) fail("the library exports no " WB_DRIVER_ENTRY ", or it returns null");
  if (api->abi != WB_DRIVER_ABI)
    fail("the plugin has ABI ", api->abi, ", this suite checks ABI ", WB_DRIVER_ABI);
  if (api->size != sizeof(wb_driver_api))
    fail("the plugin's wb_driver_api has ", api->size, " bytes, that of ABI ", WB_DRIVER_ABI,
         " has ", sizeof(wb_driver_api));
  if (!api->create || !api->destroy || !api->describe || !api->configure || !api->activate ||
      !api->deactivate || !api->read || !api->write || !api->stop || !api->acquire_frame ||
      !api->release_frame || !api->get_extension)
    fail("a function of wb_driver_api is null (only advance may be, without can_step)");
  return "ABI " + std::to_string(api->abi) + ", " + std::to_string(api->size) + " bytes";
}

std::string garbage_config(const Options& options) {
  const Library library(options.library);
  std::vector<std::string> lines;
  const wb_log log = [](void* user, wb_log_level, const char* text) {
    static_cast<std::vector<std::string>*>(user)->emplace_back(text ? text : "");
  };
  for (const char* garbage : {"]}{ : this is no configuration", "{no_such_key_of_a_driver: 1}"}) {
    lines.clear();
    if (library.entry()->create(garbage, options.folder.c_str(), log, &lines))
      fail("create accepted the configuration '", garbage, "'");
    if (lines.empty() || lines.back().empty())
      fail("create refused the configuration '", garbage, "' without a log line");
  }
  return "says: " + lines.back();
}

template <std::size_t N>
void check_name(const char (&name)[N], const std::string& what, std::set<std::string>& names) {
  if (!std::memchr(name, '\0', N)) fail(what, " has a name that is not terminated");
  if (!name[0]) fail(what, " has an empty name");
  if (!names.insert(name).second) fail("two of the description's parts are called '", name, "'");
}

std::string describe(const Options& options) {
  Session s(options);
  s.configure();
  const wb_description& d = s.description();
  std::set<std::string> names;
  check_name(d.name, "the plugin", names);
  names.clear();
  for (std::uint32_t i = 0; i < d.joint_count; ++i) {
    const wb_joint_info& j = d.joints[i];
    check_name(j.name, "joint " + std::to_string(i), names);
    const std::string joint = std::string("joint ") + j.name;
    constexpr std::uint32_t kKinds = 1u << WB_CMD_IMPEDANCE | 1u << WB_CMD_VELOCITY |
                                     1u << WB_CMD_POSITION | 1u << WB_CMD_TORQUE;
    if (j.command_kinds & ~(kKinds | 1u << WB_CMD_NONE))
      fail(joint, " names command kinds that ABI 1 has not: bits ", j.command_kinds);
    if (!(j.command_kinds & kKinds)) fail(joint, " supports no kind of command");
    if (!std::isfinite(j.position_min) || !std::isfinite(j.position_max) ||
        j.position_min > j.position_max)
      fail(joint, " has the position range ", j.position_min, " to ", j.position_max);
    if (!std::isfinite(j.velocity_max) || j.velocity_max <= 0)
      fail(joint, " has velocity_max ", j.velocity_max, ", which is no limit");
    if (!std::isfinite(j.effort_max) || j.effort_max <= 0)
      fail(joint, " has effort_max ", j.effort_max, ", which is no limit");
    if (j.is_wheel > 1) fail(joint, " has is_wheel ", j.is_wheel, ", allowed 0 or 1");
  }
  if (d.camera_count > std::size(d.cameras))
    fail("describe says ", d.camera_count, " cameras, the ABI has at most ", std::size(d.cameras));
  for (std::uint32_t i = 0; i < d.camera_count; ++i) {
    const wb_camera_info& c = d.cameras[i];
    check_name(c.name, "camera " + std::to_string(i), names);
    const std::string camera = std::string("camera ") + c.name;
    if (!c.width || !c.height) fail(camera, " has ", c.width, " x ", c.height, " pixels");
    if (!(c.fx > 0) || !(c.fy > 0) || !std::isfinite(c.fx + c.fy + c.cx + c.cy))
      fail(camera, " has the intrinsics fx ", c.fx, ", fy ", c.fy, ", cx ", c.cx, ", cy ", c.cy);
    if (!(c.range_min >= 0) || !(c.range_max > c.range_min))
      fail(camera, " has the range ", c.range_min, " to ", c.range_max, " m");
    if (!(c.rate > 0) || !std::isfinite(c.rate)) fail(camera, " has the rate ", c.rate, " Hz");
  }
  wb_description again;
  std::memset(&again, 0x5a, sizeof again);  // what is not written shows
  if (const wb_status status = s.api().describe(s.get(), &again); status != WB_OK)
    fail("describe returned ", status, " the second time");
  if (again.joint_count != d.joint_count || again.camera_count != d.camera_count ||
      again.has_imu != d.has_imu || again.has_wrench != d.has_wrench ||
      again.has_gripper != d.has_gripper || again.has_emergency_stop != d.has_emergency_stop ||
      again.can_step != d.can_step ||
      std::memcmp(again.joints, d.joints, d.joint_count * sizeof(wb_joint_info)) != 0)
    fail("describe gives another description the second time");
  if (s.steps() && !s.api().advance) fail("can_step is set and advance is null");
  return std::to_string(d.joint_count) + " joints, " + std::to_string(d.camera_count) + " cameras";
}

void expect_bad_state(wb_status got, const char* call, const char* state) {
  if (got != WB_BAD_STATE) fail(call, " while ", state, " returned ", got, ", not WB_BAD_STATE");
}

std::string states(const Options& options) {
  Session s(options);
  const wb_commands nothing{};
  const wb_timeout_action actions[WB_DRIVER_MAX_JOINTS] = {};
  const auto activate = [&] { return s.api().activate(s.get(), s.timeout_ns(), actions); };
  expect_bad_state(s.read(), "read", "unconfigured");
  expect_bad_state(s.write(nothing), "write", "unconfigured");
  expect_bad_state(s.stop(), "stop", "unconfigured");
  expect_bad_state(activate(), "activate", "unconfigured");
  expect_bad_state(s.api().deactivate(s.get()), "deactivate", "unconfigured");
  s.start();
  expect_bad_state(s.api().configure(s.get()), "configure", "inactive");
  expect_bad_state(s.api().deactivate(s.get()), "deactivate", "inactive");
  s.must_stand_still(0.2, "by commands that were written while inactive", [&](double t_s) {
    expect_bad_state(s.write(s.sweep(t_s)), "write", "inactive");
    expect_bad_state(s.stop(), "stop", "inactive");
  });
  s.activate();
  expect_bad_state(s.api().configure(s.get()), "configure", "active");
  expect_bad_state(activate(), "activate", "active");
  s.must_write(s.hold());  // still active after the refused calls
  s.tick();
  s.deactivate();
  expect_bad_state(s.write(s.hold()), "write", "inactive again");
  expect_bad_state(s.api().deactivate(s.get()), "deactivate", "inactive again");
  s.activate();
  s.must_write(s.hold());
  return "";
}

std::string extensions(const Options& options) {
  Session s(options);
  s.configure();
  for (const char* name : {"wb.check.no_such_extension/1", ""}) {
    if (s.api().get_extension(s.get(), name))
      fail("get_extension answers to '", name, "', which nobody defines");
  }
  const auto* d =
      static_cast<const wb_diagnostics*>(s.api().get_extension(s.get(), WB_DIAGNOSTICS));
  if (!d) return "no " WB_DIAGNOSTICS;
  if (!d->names || !d->read) fail(WB_DIAGNOSTICS " has a null pointer");
  std::set<std::string> names;
  for (std::uint32_t i = 0; i < d->count; ++i) {
    if (!d->names[i] || !d->names[i][0]) fail("counter ", i, " of " WB_DIAGNOSTICS " has no name");
    if (!names.insert(d->names[i]).second) fail("two counters are called '", d->names[i], "'");
  }
  std::vector<std::uint64_t> values(d->count + 1, 0x5a5a5a5a5a5a5a5a);
  d->read(s.get(), values.data());
  if (values.back() != 0x5a5a5a5a5a5a5a5a)
    fail(WB_DIAGNOSTICS " writes more values than its count");
  for (std::uint32_t i = 0; i < d->count; ++i) {
    if (values[i] == 0x5a5a5a5a5a5a5a5a) fail("counter ", d->names[i], " is not written");
  }
  return std::to_string(d->count) + " counters";
}

}  // namespace

std::vector<Check> interface_checks() {
  return {
      {"interface", "The library exports the entry symbol with this suite's ABI number and size.",
       interface},
      {"garbage_config", "A configuration that makes no sense is refused with a log line.",
       garbage_config},
      {"describe", "The description is complete, has unique names and real limits, and stays.",
       describe},
      {"states", "Calls in the wrong state return WB_BAD_STATE and do nothing.", states},
      {"extensions", "Unknown extensions are null; the counters, if any, are as the header says.",
       extensions},
  };
}

}  // namespace wb::check
