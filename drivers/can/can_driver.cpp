#include "drivers/can/can_driver.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "drivers/can/canopen/objects.hpp"
#include "drivers/can/cia402/cia402_drive.hpp"

namespace wb::can {
namespace {

constexpr TimeNs kMs = 1'000'000;
constexpr TimeNs kFuture_ns = 5 * kMs;  // DESIGN.md: commands from further ahead are refused
constexpr double kRateMargin = 1.2;     // over velocity_max: jitter of the writer
constexpr const char* kPortNames[] = {"frames_sent",    "frames_received", "frames_refused",
                                      "frames_flushed", "frames_lost",     "bus_off_restarts",
                                      "cycles"};

wb_command_kind kind_of(DriveMode mode) {
  return mode == DriveMode::kCsp   ? WB_CMD_POSITION
         : mode == DriveMode::kCsv ? WB_CMD_VELOCITY
                                   : WB_CMD_TORQUE;
}

}  // namespace

CanDriver::CanDriver(const PluginConfig& config, const std::vector<CanPort*>& ports, Pacer* pacer)
    : config_(config), pacer_(pacer), drives_(config.drives.size()) {
  for (std::size_t b = 0; b < config_.buses.size(); ++b) {
    std::vector<BusMaster::Member> members;
    for (std::size_t i = 0; i < config_.drives.size(); ++i) {
      const DriveConfig& d = config_.drives[i];
      if (d.bus != static_cast<int>(b)) continue;
      members.push_back(
          {static_cast<int>(i),
           std::make_unique<Cia402Drive>(d, config_.supervision, static_cast<int>(i), *this),
           d.node_id});
      drives_[i] = members.back().protocol.get();
    }
    buses_.push_back(std::make_unique<Bus>());
    buses_.back()->master = std::make_unique<BusMaster>(
        static_cast<int>(b), *ports[b], config_.supervision, std::move(members), *this, latch_);
  }
  std::array<TimeNs, kEvents> never;
  never.fill(INT64_MIN / 2);
  logged_at_.assign(config_.drives.size() + config_.buses.size() + 1, never);
}

CanDriver::~CanDriver() { close(); }

void CanDriver::close() {
  if (state_ == WB_UNCONFIGURED) return;
  (void)deactivate();
  state_ = WB_UNCONFIGURED;
  // The last cycles: quick stop, then no power (or the drives do it themselves, when nobody beats).
  constexpr TimeNs kLast = 350 * kMs;
  if (pacer_) {
    const TimeNs end = pacer_->bus_time() + kLast;
    while (pacer_->bus_time() < end) {
      for (auto& bus : buses_) run_cycle(*bus, pacer_->bus_time());
      if (!pacer_->advance({pacer_->bus_time() + config_.supervision.period_ns(), kNoHostTime}))
        break;
      for (auto& bus : buses_) collect(*bus, pacer_->bus_time());
    }
  } else {
    const timespec wait{0, kLast};
    nanosleep(&wait, nullptr);
  }
  for (auto& bus : buses_) bus->thread.reset();
}

TimeNs CanDriver::now() const RT_SAFE { return pacer_ ? pacer_->bus_time() : monotonic_ns(); }

// ---- one bus, on its thread (paced: the control thread)
// -------------------------------------------

void CanDriver::run_cycle(Bus& bus, TimeNs now) RT_SAFE {
  const BusCommand* command = bus.command.read();
  static const BusCommand kNothing;
  bus.master->cycle(now, command ? *command : kNothing);
}

void CanDriver::collect(Bus& bus, TimeNs now) RT_SAFE {
  bus.master->collect(now);
  BusReadings& readings = bus.readings.writing();
  bus.master->publish(now, readings);
  const PortStatus& p = readings.port;
  const std::uint64_t values[kPortCounters] = {p.sent,     p.received, p.refused,      p.flushed,
                                               p.overruns, p.restarts, readings.cycles};
  for (int i = 0; i < kPortCounters; ++i)
    bus.port_counts[static_cast<std::size_t>(i)].store(values[i], std::memory_order_relaxed);
  bus.readings.publish();
}

void CanDriver::report(const EventRecord& record, std::uint64_t times) RT_SAFE {
  const auto event = static_cast<std::size_t>(record.event);
  counts_[event].fetch_add(times, std::memory_order_relaxed);
  if (stops(record.event)) {
    // Inactive drives do not move; what is wrong shows in the readings.
    if (active_.load(std::memory_order_acquire)) latch_.stop(record.event);
  }
  const std::size_t row = record.drive >= 0
                              ? static_cast<std::size_t>(record.drive)
                              : config_.drives.size() + static_cast<std::size_t>(record.bus + 1);
  TimeNs& last = logged_at_[row][event];
  if (record.t_ns - last < kNanosPerSecond) return;
  last = record.t_ns;
  const bool taken = record.bus >= 0
                         ? buses_[static_cast<std::size_t>(record.bus)]->events.push(record)
                         : events_.push(record);
  if (!taken) counts_[static_cast<std::size_t>(Event::kLogDropped)].fetch_add(1);
  wake_log();
}

// ---- setup
// ----------------------------------------------------------------------------------------

wb_status CanDriver::configure() {
  if (state_ != WB_UNCONFIGURED) return WB_BAD_STATE;
  const Supervision& s = config_.supervision;
  const TimeNs limit = s.setup_timeout_ms * kMs;
  ++command_.activation;  // drives whose set-up failed before try again
  publish_command(false, now());
  configured_at_ = now();
  if (pacer_) {
    const TimeNs end = pacer_->bus_time() + limit;
    while (!all_ready() && !hopeless() && pacer_->bus_time() < end) {
      for (auto& bus : buses_) run_cycle(*bus, pacer_->bus_time());
      if (!pacer_->advance({pacer_->bus_time() + s.period_ns(), kNoHostTime})) {
        report({pacer_->bus_time(), Event::kBusTimeout, -1, -1, 0}, 1);
        return WB_TIMED_OUT;
      }
      for (auto& bus : buses_) collect(*bus, pacer_->bus_time());
      refresh();
    }
  } else {
    const auto window = static_cast<TimeNs>(s.tpdo_window * static_cast<double>(s.period_ns()));
    for (std::size_t b = 0; b < buses_.size(); ++b) {
      Bus* bus = buses_[b].get();
      bus->thread = std::make_unique<BusThread>(
          config_.buses[b].name, config_.buses[b].priority, s.period_ns(), window,
          BusThread::Work{[this, bus](TimeNs t) { run_cycle(*bus, t); },
                          [this, bus](TimeNs t) { collect(*bus, t); }});
      if (bus->thread->priority_refused()) report({now(), Event::kPriorityRefused, -1, -1, 0}, 1);
    }
    const TimeNs end = monotonic_ns() + limit;
    while (!all_ready() && !hopeless() && monotonic_ns() < end) {
      const timespec wait{0, 5 * kMs};
      nanosleep(&wait, nullptr);
      refresh();
    }
  }
  if (!all_ready()) {
    for (auto& bus : buses_) bus->thread.reset();
    return WB_ERROR;
  }
  state_ = WB_INACTIVE;
  return WB_OK;
}

bool CanDriver::all_ready() RT_SAFE {
  std::size_t ready = 0;
  for (std::size_t b = 0; b < buses_.size(); ++b) {
    if (readings_[b]) ready += static_cast<std::size_t>(readings_[b]->ready);
  }
  if (ready != config_.drives.size()) return false;
  for (std::size_t i = 0; i < config_.drives.size(); ++i) {
    if (joint(i).t_ns < 0 || joint(i).status == JointStatus::kLost) return false;
  }
  return true;
}

// Every drive is ready or failed, and one failed.
bool CanDriver::hopeless() const RT_SAFE {
  int ready = 0, failed = 0;
  for (const BusReadings* r : readings_) {
    if (!r || r->t_ns < configured_at_ + 2 * config_.supervision.period_ns()) continue;
    ready += r->ready;
    failed += r->failed;
  }
  return failed > 0 && ready + failed == static_cast<int>(config_.drives.size());
}

void CanDriver::refresh() RT_SAFE {
  for (std::size_t b = 0; b < buses_.size(); ++b) readings_[b] = buses_[b]->readings.read();
}

const JointMeasurement& CanDriver::joint(std::size_t i) RT_SAFE {
  const BusReadings* r = readings_[static_cast<std::size_t>(config_.drives[i].bus)];
  return r ? r->joints[i] : nothing_;
}

void CanDriver::publish_command(bool active, TimeNs alive_at) RT_SAFE {
  command_.active = active;
  command_.alive_at_ns = alive_at;
  active_.store(active, std::memory_order_release);
  for (auto& bus : buses_) {
    bus->command.writing() = command_;
    bus->command.publish();
    if (bus->thread) bus->thread->wake();
  }
}

wb_status CanDriver::activate(TimeNs command_timeout_ns, const wb_timeout_action* actions) {
  if (state_ != WB_INACTIVE) return WB_BAD_STATE;
  if (command_timeout_ns <= 0 || actions == nullptr) return WB_ERROR;
  refresh();
  ++command_.activation;
  command_.timeout_ns = command_timeout_ns;
  for (std::size_t i = 0; i < config_.drives.size(); ++i) {
    command_.actions[i] = actions[i] == WB_TIMEOUT_HOLD     ? StopAction::kHold
                          : actions[i] == WB_TIMEOUT_DAMPED ? StopAction::kDamped
                                                            : StopAction::kBrake;
    command_.targets[i] = {};
    command_.none[i] = false;
    has_accepted_[i] = false;
  }
  if (!all_ready()) {
    publish_command(false, now());  // drives whose set-up failed try again
    return WB_NOT_READY;
  }
  latch_.clear();
  state_ = WB_ACTIVE;
  publish_command(true, now());
  return WB_OK;
}

wb_status CanDriver::deactivate() {
  if (state_ != WB_ACTIVE) return WB_BAD_STATE;
  state_ = WB_INACTIVE;
  publish_command(false, now());
  return WB_OK;
}

void CanDriver::describe(wb_description& out) const {
  out = {};
  std::snprintf(out.name, sizeof out.name, "can:%zu drives on %zu buses", config_.drives.size(),
                config_.buses.size());
  for (const DriveConfig& d : config_.drives) {
    wb_joint_info& joint = out.joints[out.joint_count++];
    std::snprintf(joint.name, sizeof joint.name, "%s", d.joint.c_str());
    joint.position_min = d.position_min;
    joint.position_max = d.position_max;
    joint.velocity_max = d.velocity_max;
    joint.effort_max = d.effort_max;
    joint.command_kinds = 1u << kind_of(d.mode);
    joint.is_wheel = d.wheel;
  }
  out.can_step = pacer_ != nullptr;
}

// ---- ports
// ----------------------------------------------------------------------------------------

wb_status CanDriver::read(wb_readings& out) RT_SAFE {
  if (state_ == WB_UNCONFIGURED) return WB_BAD_STATE;
  refresh();
  const TimeNs at = now();
  out = {};
  out.t_ns = INT64_MIN;
  for (std::size_t i = 0; i < config_.drives.size(); ++i) {
    const JointMeasurement& m = joint(i);
    auto& j = out.joints[i];
    j.position = m.position;
    j.velocity = m.velocity;
    j.effort = m.torque;
    j.age_ns = m.t_ns < 0 ? INT64_MAX : at - m.t_ns;
    j.quality = m.quality;
    j.error_code = m.error_code;
    // The bus's own thread may have died or hang: nothing is valid that is older than it may be.
    const TimeNs oldest = (config_.supervision.tpdo_lost_max + 2) * config_.supervision.period_ns();
    j.valid = m.valid && j.age_ns <= oldest;
    j.status = static_cast<std::uint32_t>(m.valid && !j.valid ? JointStatus::kLost : m.status);
    if (state_ == WB_ACTIVE && latch_.stopped() && j.status == WB_JOINT_FOLLOWING)
      j.status = WB_JOINT_STOPPED;
    out.t_ns = std::max<std::int64_t>(out.t_ns, m.t_ns - host_offset_);
  }
  out.timed_out = state_ == WB_ACTIVE && latch_.stopped();
  return WB_OK;
}

wb_status CanDriver::check_joint(std::size_t i, const wb_commands& c, TimeNs at) RT_SAFE {
  const DriveConfig& d = config_.drives[i];
  const auto& in = c.joints[i];
  if (in.kind != kind_of(d.mode)) return WB_ERROR;
  const double value = d.mode == DriveMode::kCsp   ? in.position
                       : d.mode == DriveMode::kCsv ? in.velocity
                                                   : in.effort;
  // Velocity and effort beside a position are feed-forward, which these drives do not take; a
  // command that is not a number is refused all the same.
  const bool finite =
      std::isfinite(value) &&
      (d.mode != DriveMode::kCsp || (std::isfinite(in.velocity) && std::isfinite(in.effort)));
  if (!finite) return WB_ERROR;
  if (d.mode == DriveMode::kCsv) return std::abs(value) <= d.velocity_max ? WB_OK : WB_ERROR;
  if (d.mode == DriveMode::kCst) return std::abs(value) <= d.effort_max ? WB_OK : WB_ERROR;
  if (d.position_max > d.position_min && (value < d.position_min || value > d.position_max))
    return WB_ERROR;
  // Over rate: against the last accepted target once the drive follows, else against where it is.
  const JointMeasurement& m = joint(i);
  const TimeNs period = config_.supervision.period_ns();
  const bool follows = m.status == JointStatus::kFollowing && has_accepted_[i];
  const double step =
      kRateMargin * d.velocity_max * to_seconds(std::clamp(at - accepted_at_, period, 10 * period));
  const double start = d.following_max > 0 ? d.following_max : 0.02 * d.velocity_max;
  if (follows) return std::abs(value - accepted_[i]) <= step ? WB_OK : WB_ERROR;
  return m.valid && std::abs(value - m.position) <= step + start ? WB_OK : WB_ERROR;
}

wb_status CanDriver::write(const wb_commands& c) RT_SAFE {
  if (state_ != WB_ACTIVE) return WB_BAD_STATE;
  if (latch_.stopped()) return WB_TIMED_OUT;
  const TimeNs at = now();
  const TimeNs age = at - host_offset_ - c.t_ns;
  if (age > config_.supervision.command_age_ms * kMs || age < -kFuture_ns) {
    report({at, Event::kCommandStale, -1, -1, static_cast<std::uint32_t>(std::abs(age) / 1000)}, 1);
    return WB_ERROR;
  }
  for (std::size_t i = 0; i < config_.drives.size(); ++i) {
    if (c.joints[i].kind == WB_CMD_NONE || check_joint(i, c, at) == WB_OK) continue;
    report({at, Event::kCommandRejected, -1, static_cast<int>(i), c.joints[i].kind}, 1);
    return WB_ERROR;
  }
  for (std::size_t i = 0; i < config_.drives.size(); ++i) {
    const auto& in = c.joints[i];
    command_.none[i] = in.kind == WB_CMD_NONE;
    has_accepted_[i] = !command_.none[i];
    command_.targets[i].given = has_accepted_[i];
    if (!has_accepted_[i]) continue;
    const DriveMode mode = config_.drives[i].mode;
    command_.targets[i].value = mode == DriveMode::kCsp   ? in.position
                                : mode == DriveMode::kCsv ? in.velocity
                                                          : in.effort;
    accepted_[i] = command_.targets[i].value;
  }
  accepted_at_ = at;
  written_ = true;
  last_write_ = at;
  publish_command(true, at);
  return WB_OK;
}

wb_status CanDriver::stop() RT_SAFE {
  if (state_ != WB_ACTIVE) return WB_BAD_STATE;
  report({now(), Event::kStopRequested, -1, -1, 0}, 1);
  for (auto& bus : buses_) {
    if (bus->thread) bus->thread->wake();
  }
  return WB_OK;
}

wb_status CanDriver::advance(TimeNs t_ns) RT_SAFE {
  if (!pacer_ || state_ == WB_UNCONFIGURED) return WB_BAD_STATE;
  if (!clock_started_) {
    clock_started_ = true;
    host_offset_ = pacer_->bus_time() - t_ns;
    next_cycle_ = pacer_->bus_time();
  }
  const TimeNs target = t_ns + host_offset_, period = config_.supervision.period_ns();
  while (pacer_->bus_time() < target) {
    const TimeNs at = pacer_->bus_time();
    if (written_ || at >= next_cycle_) {
      for (auto& bus : buses_) run_cycle(*bus, at);
      written_ = false;
      // While somebody writes, SYNC is the control tick; without, it goes on by itself.
      next_cycle_ = at + (at - last_write_ < 2 * period ? period + period / 2 : period);
    }
    const TimeNs to = std::min(target, next_cycle_);
    if (!pacer_->advance({to, to - host_offset_})) {
      report({at, Event::kBusTimeout, -1, -1, 0}, 1);
      return WB_TIMED_OUT;
    }
    for (auto& bus : buses_) collect(*bus, to);
  }
  refresh();
  return WB_OK;
}

// ---- log and counters
// -----------------------------------------------------------------------------

std::string CanDriver::line_of(const EventRecord& r) const {
  std::string line = "CAN";
  if (r.bus >= 0) line += " bus " + config_.buses[static_cast<std::size_t>(r.bus)].name;
  if (r.drive >= 0) {
    const DriveConfig& d = config_.drives[static_cast<std::size_t>(r.drive)];
    line += ", drive " + d.joint + " (node " + std::to_string(d.node_id) + ")";
  }
  const EventText& text = text_of(r.event);
  char value[64];
  std::snprintf(value, sizeof value, text.hex ? ": %s 0x%X" : ": %s %u", text.text, r.value);
  line += r.value != 0 ? value : std::string(": ") + text.text;
  if (r.event == Event::kDriveReady)
    line += std::string(" (") + drives_[static_cast<std::size_t>(r.drive)]->device_name() + ")";
  if (r.event == Event::kSdoAbort)
    line += std::string(" (") + name_of(static_cast<SdoAbort>(r.value)) + ")";
  return line;
}

void CanDriver::drain_log(const Line& line) {
  log_seen_ = log_ticks_.load();
  const auto put = [&](const EventRecord& r) {
    const wb_log_level level = r.event == Event::kDriveReady ? WB_LOG_INFO
                               : stops(r.event)              ? WB_LOG_ERROR
                                                             : WB_LOG_WARN;
    line(level, line_of(r));
  };
  EventRecord record;
  while (events_.pop(record)) put(record);
  for (auto& bus : buses_) {
    while (bus->events.pop(record)) put(record);
  }
}

const std::vector<const char*>& CanDriver::counter_names() {
  static const std::vector<const char*> names = [] {
    std::vector<const char*> n;
    for (int i = 0; i < kEvents; ++i) n.push_back(text_of(static_cast<Event>(i)).name);
    n.insert(n.end(), std::begin(kPortNames), std::end(kPortNames));
    return n;
  }();
  return names;
}

void CanDriver::counters(std::uint64_t* values) const {
  for (std::size_t i = 0; i < counts_.size(); ++i)
    values[i] = counts_[i].load(std::memory_order_relaxed);
  for (int i = 0; i < kPortCounters; ++i) {
    std::uint64_t sum = 0;
    for (const auto& bus : buses_)
      sum += bus->port_counts[static_cast<std::size_t>(i)].load(std::memory_order_relaxed);
    values[static_cast<std::size_t>(kEvents + i)] = sum;
  }
}

}  // namespace wb::can
