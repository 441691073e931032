// libwb_driver_robotiq.so: a Robotiq 2F-85 over Modbus RTU behind the driver ABI; a gripper, no
// joints. Worlds: create, describe, configure, activate, deactivate, destroy are setup; read,
// write, stop are ports: they exchange values with the plugin's thread and never touch the line.
// Clock: CLOCK_MONOTONIC, so that the plugin can not be stepped.
#include <algorithm>
#include <cstring>
#include <exception>
#include <memory>
#include <string>

#include "core/rt/executor.hpp"
#include "drivers/driver.h"
#include "drivers/robotiq/worker.hpp"

struct wb_driver {
  wb::robotiq::Config config;
  wb_log log = nullptr;
  void* log_user = nullptr;
  std::unique_ptr<wb::robotiq::Worker> worker;  // from configure on
  wb_state state = WB_UNCONFIGURED;
  wb::robotiq::Request request;

  void say(wb_log_level level, const std::string& text) const {
    if (log != nullptr) log(log_user, level, text.c_str());
  }
};

namespace wb::robotiq {
namespace {

constexpr TimeNs kFirstAnswerNs = 3 * kNanosPerSecond;  // configure waits this long at least

const char* describe(LinkResult result) {
  switch (result) {
    case LinkResult::kOk:
      return "answers";
    case LinkResult::kClosed:
      return "the port cannot be opened";
    case LinkResult::kTimedOut:
      return "no answer";
    case LinkResult::kBadChecksum:
      return "answers have bad checksums";
    case LinkResult::kOtherError:
      return "answers make no sense";
  }
  return "";
}

wb_driver* create(const char* config, const char*, wb_log log, void* log_user) {
  auto driver = std::make_unique<wb_driver>();
  driver->log = log;
  driver->log_user = log_user;
  try {
    driver->config = Config::parse(config);
  } catch (const std::exception& error) {
    driver->say(WB_LOG_ERROR, error.what());
    return nullptr;
  }
  return driver.release();
}

void destroy(wb_driver* driver) { delete driver; }

wb_status describe(const wb_driver*, wb_description* out) {
  *out = {};
  std::strncpy(out->name, "robotiq:2f85", sizeof out->name - 1);
  out->has_gripper = 1;
  return WB_OK;
}

wb_status configure(wb_driver* driver) {
  if (driver->state != WB_UNCONFIGURED) return WB_BAD_STATE;
  driver->worker = std::make_unique<Worker>(driver->config);
  const TimeNs end =
      RealTime::monotonic() + std::max(kFirstAnswerNs, driver->config.silence_max_ns);
  while (driver->worker->newest() == nullptr) {
    if (RealTime::monotonic() > end) {
      driver->say(WB_LOG_ERROR, "gripper on " + driver->config.device + ", slave " +
                                    std::to_string(driver->config.slave) + ": " +
                                    describe(driver->worker->last_result()));
      driver->worker.reset();
      return WB_ERROR;
    }
    const timespec t{0, 5'000'000};
    nanosleep(&t, nullptr);
  }
  driver->say(WB_LOG_INFO, "gripper on " + driver->config.device + " answers");
  driver->state = WB_INACTIVE;
  return WB_OK;
}

wb_status activate(wb_driver* driver, std::int64_t command_timeout_ns, const wb_timeout_action*) {
  if (driver->state != WB_INACTIVE) return WB_BAD_STATE;
  if (command_timeout_ns <= 0) return WB_ERROR;
  Request& r = driver->request;
  r.activation += 1;
  r.timeout_ns = command_timeout_ns;
  r.written = r.hold = false;
  driver->worker->request(r);
  driver->state = WB_ACTIVE;
  return WB_OK;
}

wb_status stop(wb_driver* driver) {
  if (driver->state != WB_ACTIVE) return WB_BAD_STATE;
  driver->request.hold = true;
  driver->worker->request(driver->request);
  return WB_OK;
}

wb_status deactivate(wb_driver* driver) {
  if (stop(driver) != WB_OK) return WB_BAD_STATE;
  driver->state = WB_INACTIVE;
  return WB_OK;
}

bool timed_out(const wb_driver* driver) {
  return driver->request.hold || driver->worker->expired(driver->request.activation);
}

wb_status read(wb_driver* driver, wb_readings* out) {
  if (driver->state == WB_UNCONFIGURED) return WB_BAD_STATE;
  const Report& report = *driver->worker->newest();
  *out = {};
  out->t_ns = report.t_ns;
  const bool active = driver->state == WB_ACTIVE;
  out->timed_out = active && timed_out(driver);
  if (RealTime::monotonic() - report.t_ns > driver->config.silence_max_ns) return WB_ERROR;
  if (active && report.lost == driver->request.activation) return WB_ERROR;
  // Before its activation the gripper does not know where its fingers are.
  out->gripper.valid = report.status.activation == Activation::kDone;
  out->gripper.opening = opening_m(report.status.position, driver->config.stroke);
  out->gripper.force = report.force_n;
  return WB_OK;
}

wb_status write(wb_driver* driver, const wb_commands* commands) {
  if (driver->state != WB_ACTIVE) return WB_BAD_STATE;
  Request& r = driver->request;
  const TimeNs now = RealTime::monotonic();
  if (r.overdue(now)) driver->worker->expire(r.activation);
  if (timed_out(driver)) return WB_TIMED_OUT;
  const auto& c = commands->gripper;
  if (!std::isfinite(c.opening) || !std::isfinite(c.force)) return WB_ERROR;
  r.position = position_counts(c.opening, driver->config.stroke);
  r.force = force_counts(c.force);
  r.t_ns = now;
  r.written = true;
  driver->worker->request(r);
  return WB_OK;
}

wb_status acquire_frame(wb_driver*, wb_frame*) { return WB_NO_DATA; }
wb_status release_frame(wb_driver*, std::uint64_t) { return WB_BAD_STATE; }
wb_status advance(wb_driver*, std::int64_t) { return WB_BAD_STATE; }

constexpr const char* kCounterNames[] = {"exchanges", "time_outs", "checksum_errors",
                                         "other_errors", "port_losses"};

void read_counters(const wb_driver* driver, std::uint64_t* values) {
  std::fill_n(values, std::size(kCounterNames), 0);
  if (!driver->worker) return;
  const Counters& c = driver->worker->counters();
  for (const auto* n : {&c.exchanges, &c.time_outs, &c.checksum_errors, &c.other_errors, &c.closed})
    *values++ = n->load(std::memory_order_relaxed);
}

const void* get_extension(wb_driver*, const char* name) {
  static const wb_diagnostics diagnostics = {std::size(kCounterNames), kCounterNames,
                                             read_counters};
  return std::strcmp(name, WB_DIAGNOSTICS) == 0 ? &diagnostics : nullptr;
}

}  // namespace
}  // namespace wb::robotiq

extern "C" __attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry() {
  using namespace wb::robotiq;
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
