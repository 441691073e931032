#include "drivers/check/session.hpp"

#include <dlfcn.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

#include "core/rt/allocation_count.hpp"

namespace wb::check {
namespace {

// Log lines count against a port only if they come from the thread that is inside it.
thread_local PortUse* inside = nullptr;

TimeNs clock_ns(clockid_t clock) {
  timespec t{};
  clock_gettime(clock, &t);
  return t.tv_sec * kNanosPerSecond + t.tv_nsec;
}

}  // namespace

std::string text_of(wb_status status) {
  constexpr const char* kNames[] = {"WB_OK",      "WB_ERROR",     "WB_NOT_READY",
                                    "WB_NO_DATA", "WB_BAD_STATE", "WB_TIMED_OUT"};
  const auto i = static_cast<unsigned>(status);
  return i <= WB_TIMED_OUT ? kNames[i] : "status " + std::to_string(i);
}

std::string text_of(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string joint_status_text(std::uint32_t status) {
  constexpr const char* kNames[] = {"UNKNOWN", "DISABLED", "FOLLOWING", "STOPPED", "FAULT", "LOST"};
  return status <= WB_JOINT_LOST ? kNames[status] : std::to_string(status);
}

wb_command_kind kind_of(const wb_joint_info& info) {
  for (const wb_command_kind k :
       {WB_CMD_IMPEDANCE, WB_CMD_POSITION, WB_CMD_VELOCITY, WB_CMD_TORQUE}) {
    if (info.command_kinds & (1u << k)) return k;
  }
  return WB_CMD_NONE;
}

Library::Library(const std::filesystem::path& file) {
  handle_ = dlopen(std::filesystem::absolute(file).c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!handle_) throw std::runtime_error(dlerror());
}

const wb_driver_api* Library::entry() const {
  const auto symbol = reinterpret_cast<wb_driver_entry_fn>(dlsym(handle_, WB_DRIVER_ENTRY));
  return symbol ? symbol() : nullptr;
}

Session::Session(const Options& options)
    : options_(options),
      library_(options.library),
      api_(library_.entry()),
      period_ns_(from_seconds(1.0 / options.rate_hz)),
      timeout_ns_(from_seconds(1e-3 * options.timeout_ms)) {
  driver_ = api_->create(options_.config.c_str(), options_.folder.c_str(), log, this);
  if (!driver_) fail("create gave null", why());
}

Session::~Session() { api_->destroy(driver_); }

void Session::log(void* user, wb_log_level level, const char* text) {
  if (inside) ++inside->log_lines;
  if (!text) return;
  auto* self = static_cast<Session*>(user);
  const std::lock_guard lock(self->log_mutex_);
  self->line_ = text;
  if (level >= WB_LOG_WARN) self->problem_ = text;
}

std::string Session::newest_line() const {
  const std::lock_guard lock(log_mutex_);
  return line_;
}

std::string Session::why() const {
  for (int i = 0; i < 50; ++i) {
    {
      const std::lock_guard lock(log_mutex_);
      if (!problem_.empty()) return ": " + problem_;
    }
    const timespec wait{0, 10'000'000};
    nanosleep(&wait, nullptr);
  }
  return "";
}

template <class Call>
wb_status Session::port(Port which, Call&& call) {
  PortUse& use = use_[which];
  inside = &use;
  const std::uint64_t allocations = thread_allocations(), lines = use.log_lines;
  const TimeNs cpu = clock_ns(CLOCK_THREAD_CPUTIME_ID), wall = clock_ns(CLOCK_MONOTONIC);
  const wb_status status = call();
  use.wall_max_ns = std::max(use.wall_max_ns, clock_ns(CLOCK_MONOTONIC) - wall);
  use.cpu_max_ns = std::max(use.cpu_max_ns, clock_ns(CLOCK_THREAD_CPUTIME_ID) - cpu);
  // A line from within is a fault of its own; that our log callback stores it is not another.
  if (use.log_lines == lines) use.allocations += thread_allocations() - allocations;
  ++use.calls;
  inside = nullptr;
  return status;
}

TimeNs Session::now() const { return steps() ? virtual_ns_ : clock_ns(CLOCK_MONOTONIC); }

wb_status Session::read() {
  return port(kRead, [&] { return api_->read(driver_, &readings_); });
}
wb_status Session::write(const wb_commands& commands) {
  return port(kWrite, [&] { return api_->write(driver_, &commands); });
}
wb_status Session::stop() {
  return port(kStop, [&] { return api_->stop(driver_); });
}

void Session::configure() {
  if (const wb_status s = api_->configure(driver_); s != WB_OK)
    fail("configure returned ", s, why());
  if (const wb_status s = api_->describe(driver_, &description_); s != WB_OK)
    fail("describe returned ", s);
  if (description_.joint_count > WB_DRIVER_MAX_JOINTS)
    fail("describe says ", description_.joint_count, " joints, the ABI has at most ",
         WB_DRIVER_MAX_JOINTS);
  if (steps()) {
    if (const wb_status s = port(kAdvance, [&] { return api_->advance(driver_, 0); }); s != WB_OK)
      fail("advance to time 0 returned ", s);
  }
  next_ns_ = now();
}

void Session::tick() {
  if (steps()) {
    virtual_ns_ += period_ns_;
    const wb_status s = port(kAdvance, [&] { return api_->advance(driver_, virtual_ns_); });
    if (s != WB_OK) fail("advance returned ", s);
    return;
  }
  next_ns_ = std::max(next_ns_ + period_ns_, now());
  const timespec t{next_ns_ / kNanosPerSecond, next_ns_ % kNanosPerSecond};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

void Session::must_read() {
  if (const wb_status s = read(); s != WB_OK) fail("read returned ", s);
}

void Session::must_write(const wb_commands& commands) {
  const TimeNs silence = now() - written_ns_;
  const wb_status s = write(commands);
  if (s == WB_TIMED_OUT && 5 * silence > 4 * timeout_ns_)
    throw Skipped{"this machine did not come to write for " + text_of(1e3 * to_seconds(silence)) +
                  " ms, the time-out is " + text_of(1e3 * to_seconds(timeout_ns_)) + " ms"};
  if (s != WB_OK) fail("write of a proper command returned ", s, why());
  written_ns_ = now();
}

void Session::rest(double seconds) {
  for (const TimeNs end = now() + from_seconds(seconds); now() < end;) {
    tick();
    must_read();
  }
}

void Session::start() {
  configure();
  const TimeNs end = now() + from_seconds(options_.start_s);
  for (;;) {
    const wb_status s = read();
    std::uint32_t missing = 0;
    while (s == WB_OK && missing < joints() && readings_.joints[missing].valid) ++missing;
    if (s == WB_OK && missing == joints()) return;
    if (now() >= end) {
      if (s != WB_OK) fail("read still returns ", s, " ", options_.start_s, " s after configure");
      fail("joint ", joint(missing), " is still not valid ", options_.start_s,
           " s after configure");
    }
    tick();
  }
}

void Session::activate() {
  must_read();
  for (std::uint32_t j = 0; j < joints(); ++j) {
    home_[j] = readings_.joints[j].position;
    const double effort = readings_.joints[j].effort, most = description_.joints[j].effort_max;
    home_effort_[j] = std::isfinite(effort) ? std::clamp(effort, -most, most) : 0.0;
  }
  std::array<wb_timeout_action, WB_DRIVER_MAX_JOINTS> actions{};
  for (std::uint32_t j = 0; j < joints(); ++j)
    actions[j] = description_.joints[j].is_wheel ? WB_TIMEOUT_BRAKE : WB_TIMEOUT_HOLD;
  if (const wb_status s = api_->activate(driver_, timeout_ns_, actions.data()); s != WB_OK)
    fail("activate returned ", s, why());
  next_ns_ = written_ns_ = now();  // it may have blocked
}

void Session::deactivate() {
  if (const wb_status s = api_->deactivate(driver_); s != WB_OK) fail("deactivate returned ", s);
  next_ns_ = now();
}

wb_commands Session::hold() const { return sweep(0.0); }

wb_commands Session::sweep(double t_s) const {
  wb_commands out{};
  out.t_ns = now();
  for (std::uint32_t j = 0; j < joints(); ++j) {
    const wb_joint_info& info = description_.joints[j];
    auto& c = out.joints[j];
    c.kind = kind_of(info);
    double speed = t_s > 0 ? std::min(0.1 * info.velocity_max, 0.1) : 0.0;
    if (info.position_min < info.position_max &&
        home_[j] > 0.5 * (info.position_min + info.position_max))
      speed = -speed;
    if (c.kind == WB_CMD_VELOCITY) {
      c.velocity = speed;
      continue;
    }
    c.effort = home_effort_[j];
    if (c.kind == WB_CMD_TORQUE) continue;
    c.position = home_[j] + speed * t_s;
    c.velocity = speed;
    if (c.kind != WB_CMD_IMPEDANCE) continue;
    c.stiffness = options_.stiffness > 0 ? options_.stiffness : info.effort_max;
    c.damping = options_.damping > 0 ? options_.damping : 0.1 * c.stiffness;
  }
  out.gripper.opening = readings_.gripper.valid ? readings_.gripper.opening : 0.0;
  return out;
}

Session::Motion Session::watch(double seconds, const std::function<void(double)>& each_tick) {
  must_read();
  const wb_readings from = readings_;
  const TimeNs start = now();
  Motion most;
  while (now() - start < from_seconds(seconds)) {
    each_tick(to_seconds(now() - start));
    tick();
    must_read();
    for (std::uint32_t j = 0; j < joints(); ++j) {
      const double d = std::abs(readings_.joints[j].position - from.joints[j].position);
      if (!std::isfinite(d)) fail("joint ", joint(j), " reads a position that is not finite");
      if (d > most.distance) most = {d, j};
    }
  }
  return most;
}

void Session::must_stand_still(double seconds, const std::string& when,
                               const std::function<void(double)>& each_tick) {
  const Motion m = watch(seconds, each_tick);
  if (m.distance > options_.motion_tolerance)
    fail("joint ", joint(m.joint), " moved by ", m.distance, " ", when, ", allowed ",
         options_.motion_tolerance);
}

}  // namespace wb::check
