// Simulated motors behind the driver ABI with at most one defect, chosen by -DDEFECT=kName, to show
// that the conformance suite finds it; kNone conforms. REAL_TIME: on the monotonic clock instead of
// a virtual one. Three joints: by impedance, by position, a wheel; a camera of 4 x 3 pixels.
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string>

#include "drivers/driver.h"

#ifndef REAL_TIME
#define REAL_TIME 0
#endif

namespace {

enum class Defect {
  kNone,
  kWrongAbi,
  kWrongSize,
  kAcceptsGarbage,
  kRefusesSilently,
  kCrashesOnGarbage,
  kDuplicateName,
  kNoEffortLimit,
  kKnowsEveryExtension,
  kWritesWhileInactive,
  kMovesAtActivate,
  kIgnoresTimeOut,
  kTimesOutEarly,
  kUnlatchedTimeOut,
  kUnlatchedStop,
  kCoastsAfterDeactivate,
  kAcceptsNan,
  kAcceptsEveryKind,
  kDoesNotClip,
  kDoesNotFollow,
  kRunsBackwards,
  kStaleAgeAsFresh,
  kStampGoesBack,
  kUnknownStatus,
  kQualityInPercent,
  kAllocatesInRead,
  kLogsFromWrite,
  kReleasesTwice,
  kNanDepth,
};
constexpr Defect kDefect = Defect::DEFECT;
constexpr bool is(Defect defect) { return kDefect == defect; }

constexpr int kJoints = 3, kSlots = 3;
constexpr std::int64_t kStepNs = 500'000, kSampleNs = 10'000'000, kFrameNs = 20'000'000;
constexpr const char* kNames[kJoints] = {"shoulder", "elbow", "wheel"};
constexpr std::uint32_t kKinds[kJoints] = {WB_CMD_IMPEDANCE, WB_CMD_POSITION, WB_CMD_VELOCITY};
constexpr double kVelocityMax = 2.0, kEffortMax = 20.0, kRange = 2.0;

std::int64_t monotonic_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return std::int64_t{t.tv_sec} * 1'000'000'000 + t.tv_nsec;
}

}  // namespace

struct wb_driver {
  wb_log log = nullptr;
  void* user = nullptr;
  wb_state state = WB_UNCONFIGURED;
  std::int64_t now = 0, sampled = 0, timeout = 0, last_write = 0;
  bool commanded = false, stopped = false, timed_out = false;
  wb_commands commands{};
  struct {
    double position, velocity, effort;
  } joints[kJoints] = {};
  wb_readings readings{};
  struct {
    int state;  // 0 free, 1 ready, 2 taken
    std::int64_t t;
    float depth[12];
  } slots[kSlots] = {};
  std::int64_t exposed = 0;
};

namespace {

bool follows(const wb_driver& d) {
  return d.commanded && !d.stopped && (d.state == WB_ACTIVE || is(Defect::kCoastsAfterDeactivate));
}

void move(wb_driver& d) {
  const double dt = 1e-9 * kStepNs;
  for (int j = 0; j < kJoints; ++j) {
    auto& s = d.joints[j];
    const auto& c = d.commands.joints[j];
    double velocity_max = kVelocityMax, effort_max = kEffortMax;
    if (is(Defect::kDoesNotClip)) velocity_max = effort_max = 1e3;
    double wanted = 0;
    s.effort = 0;
    if (follows(d)) {
      if (c.kind == WB_CMD_IMPEDANCE) {
        s.effort = std::clamp(c.stiffness * (c.position - s.position) +
                                  c.damping * (c.velocity - s.velocity) + c.effort,
                              -effort_max, effort_max);
        wanted = std::clamp(s.velocity + dt * (s.effort - s.velocity), -velocity_max, velocity_max);
      } else if (c.kind == WB_CMD_POSITION) {
        const double target = std::clamp(c.position, -kRange, kRange);
        wanted = std::clamp(50 * (target - s.position), -velocity_max, velocity_max);
      } else if (c.kind == WB_CMD_VELOCITY) {
        wanted = std::clamp(c.velocity, -velocity_max, velocity_max);
      }
    }
    // Whoever only watches the status sees nothing of these.
    if (is(Defect::kDoesNotFollow) && j == 1) wanted = 0;
    if (is(Defect::kRunsBackwards) && j == 2) wanted = -wanted;
    if (is(Defect::kMovesAtActivate) && d.state == WB_ACTIVE && !d.commanded) wanted = 0.2;
    s.velocity = wanted;
    s.position += dt * s.velocity;
  }
}

void sample(wb_driver& d) {
  d.sampled = d.now;
  d.readings.t_ns = d.now;
  if (is(Defect::kStampGoesBack) && d.now % 1'000'000'000 > 700'000'000)
    d.readings.t_ns -= 15'000'000;
  for (int j = 0; j < kJoints; ++j) {
    auto& r = d.readings.joints[j];
    r.position = d.joints[j].position;
    r.velocity = d.joints[j].velocity;
    r.effort = d.joints[j].effort;
    r.quality = is(Defect::kQualityInPercent) ? 100.0 : 1.0;
    r.valid = 1;
  }
}

void expose(wb_driver& d) {
  d.exposed = d.now;
  auto* slot = std::find_if(d.slots, d.slots + kSlots, [](auto& s) { return s.state == 0; });
  if (slot == d.slots + kSlots) {  // the oldest that nobody holds
    slot = nullptr;
    for (auto& s : d.slots) {
      if (s.state == 1 && (!slot || s.t < slot->t)) slot = &s;
    }
  }
  if (!slot) return;
  slot->state = 1;
  slot->t = d.now;
  std::fill_n(slot->depth, 12, 1.5f);
  if (is(Defect::kNanDepth)) slot->depth[5] = std::numeric_limits<float>::quiet_NaN();
}

// Brings the motors to t.
void run_to(wb_driver& d, std::int64_t t) {
  while (d.now + kStepNs <= t) {
    d.now += kStepNs;
    const std::int64_t silence = d.now - d.last_write;
    const std::int64_t timeout = is(Defect::kTimesOutEarly) ? d.timeout / 2 : d.timeout;
    if (d.state == WB_ACTIVE && d.commanded && !d.stopped && silence > timeout &&
        !is(Defect::kIgnoresTimeOut))
      d.stopped = d.timed_out = true;
    move(d);
    if (d.now - d.sampled >= kSampleNs) sample(d);
    if (d.now - d.exposed >= kFrameNs) expose(d);
  }
}

void catch_up(wb_driver& d) {
  if (REAL_TIME) run_to(d, monotonic_ns());
}

wb_driver* create(const char* config, const char*, wb_log log, void* user) {
  if (std::string(config) != "{kind: motors}") {
    if (is(Defect::kCrashesOnGarbage)) std::abort();
    if (!is(Defect::kRefusesSilently)) log(user, WB_LOG_ERROR, "configuration: {kind: motors}");
    if (!is(Defect::kAcceptsGarbage)) return nullptr;
  }
  auto* d = new wb_driver;
  d->log = log;
  d->user = user;
  return d;
}
void destroy(wb_driver* d) { delete d; }

wb_status describe(const wb_driver*, wb_description* out) {
  *out = {};
  std::strcpy(out->name, "motors");
  out->joint_count = kJoints;
  for (int j = 0; j < kJoints; ++j) {
    wb_joint_info& info = out->joints[j];
    std::strcpy(info.name, kNames[is(Defect::kDuplicateName) ? 0 : j]);
    info.velocity_max = kVelocityMax;
    info.effort_max = is(Defect::kNoEffortLimit) && j == 1 ? 0.0 : kEffortMax;
    info.command_kinds = 1u << kKinds[j];
    info.is_wheel = j == 2;
    if (!info.is_wheel) info.position_min = -kRange, info.position_max = kRange;
  }
  out->camera_count = 1;
  wb_camera_info& camera = out->cameras[0];
  std::strcpy(camera.name, "camera");
  camera = {"camera", 4, 3, 3, 3, 2, 1.5, 0.1, 5, 1e9 / kFrameNs, 0};
  out->can_step = !REAL_TIME;
  return WB_OK;
}

wb_status configure(wb_driver* d) {
  if (d->state != WB_UNCONFIGURED) return WB_BAD_STATE;
  d->state = WB_INACTIVE;
  if (REAL_TIME) d->now = d->exposed = monotonic_ns();
  sample(*d);
  return WB_OK;
}
wb_status activate(wb_driver* d, std::int64_t timeout_ns, const wb_timeout_action*) {
  if (d->state != WB_INACTIVE) return WB_BAD_STATE;
  catch_up(*d);
  d->state = WB_ACTIVE;
  d->timeout = timeout_ns;
  d->commanded = d->stopped = d->timed_out = false;
  return WB_OK;
}
wb_status deactivate(wb_driver* d) {
  if (d->state != WB_ACTIVE) return WB_BAD_STATE;
  catch_up(*d);
  d->state = WB_INACTIVE;
  return WB_OK;
}

wb_status read(wb_driver* d, wb_readings* out) {
  if (d->state == WB_UNCONFIGURED) return WB_BAD_STATE;
  catch_up(*d);
  if (is(Defect::kAllocatesInRead)) {
    char* volatile buffer = static_cast<char*>(std::malloc(64));
    std::free(buffer);
  }
  const bool following = d->state == WB_ACTIVE && follows(*d);
  for (int j = 0; j < kJoints; ++j) {
    auto& r = d->readings.joints[j];
    r.age_ns = is(Defect::kStaleAgeAsFresh) ? 0 : d->now - d->sampled;
    r.status = is(Defect::kUnknownStatus) && following ? WB_JOINT_UNKNOWN
               : following                             ? WB_JOINT_FOLLOWING
               : d->stopped                            ? WB_JOINT_STOPPED
                                                       : WB_JOINT_DISABLED;
  }
  d->readings.timed_out = d->timed_out;
  *out = d->readings;
  return WB_OK;
}

wb_status write(wb_driver* d, const wb_commands* commands) {
  if (is(Defect::kWritesWhileInactive) && d->state == WB_INACTIVE) return WB_OK;
  if (d->state != WB_ACTIVE) return WB_BAD_STATE;
  catch_up(*d);
  if (d->stopped) {
    const bool unlatched =
        d->timed_out ? is(Defect::kUnlatchedTimeOut) : is(Defect::kUnlatchedStop);
    if (!unlatched) return WB_TIMED_OUT;
    d->stopped = d->timed_out = false;
  }
  for (int j = 0; j < kJoints; ++j) {
    const auto& c = commands->joints[j];
    const bool finite = std::isfinite(c.position + c.velocity + c.effort + c.stiffness + c.damping);
    const bool known = c.kind == kKinds[j] || c.kind == WB_CMD_NONE;
    if ((!finite && !is(Defect::kAcceptsNan)) || (!known && !is(Defect::kAcceptsEveryKind))) {
      if (is(Defect::kLogsFromWrite)) d->log(d->user, WB_LOG_WARN, "a command was refused");
      return WB_ERROR;
    }
    if (!finite) return WB_OK;  // accepted, and ignored
  }
  d->commands = *commands;
  d->commanded = true;
  d->last_write = d->now;
  return WB_OK;
}

wb_status stop(wb_driver* d) {
  if (d->state != WB_ACTIVE) return WB_BAD_STATE;
  catch_up(*d);
  d->stopped = true;
  return WB_OK;
}

wb_status acquire_frame(wb_driver* d, wb_frame* out) {
  auto* oldest = static_cast<decltype(&d->slots[0])>(nullptr);
  for (auto& s : d->slots) {
    if (s.state == 1 && (!oldest || s.t < oldest->t)) oldest = &s;
  }
  if (!oldest) return WB_NO_DATA;
  oldest->state = 2;
  *out = {};
  out->t_ns = oldest->t;
  out->depth = oldest->depth;
  out->token = static_cast<std::uint64_t>(oldest - d->slots);
  return WB_OK;
}
wb_status release_frame(wb_driver* d, std::uint64_t token) {
  if (token >= kSlots) return WB_ERROR;
  if (d->slots[token].state != 2 && !is(Defect::kReleasesTwice)) return WB_ERROR;
  d->slots[token].state = 0;
  return WB_OK;
}

wb_status advance(wb_driver* d, std::int64_t t_ns) {
  if (d->state == WB_UNCONFIGURED || REAL_TIME) return WB_BAD_STATE;
  run_to(*d, t_ns);
  return WB_OK;
}
const void* get_extension(wb_driver* d, const char*) {
  return is(Defect::kKnowsEveryExtension) ? d : nullptr;
}

}  // namespace

extern "C" __attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry() {
  static const wb_driver_api api = {is(Defect::kWrongAbi) ? 7 : WB_DRIVER_ABI,
                                    is(Defect::kWrongSize) ? 64 : sizeof(wb_driver_api),
                                    create,
                                    destroy,
                                    describe,
                                    configure,
                                    activate,
                                    deactivate,
                                    read,
                                    write,
                                    stop,
                                    acquire_frame,
                                    release_frame,
                                    advance,
                                    get_extension};
  return &api;
}
