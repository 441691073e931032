#include <time.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <sstream>

#include "drivers/check/checks.hpp"

namespace wb::check {
namespace {

constexpr double kSettleS = 0.5;  // for joints to come to rest after they were let go

std::string still_until_written(const Options& options) {
  Session s(options);
  s.start();
  s.activate();
  s.must_stand_still(0.5, "between activate and the first write", [](double) {});
  return "";
}

// Commands a sweep for so long; every write must be accepted.
void sweep(Session& s, double seconds) {
  s.watch(seconds, [&](double t_s) { s.must_write(s.sweep(t_s)); });
}

void must_be_halted(Session& s, const std::string& when) {
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    if (s.readings().joints[j].status == WB_JOINT_FOLLOWING)
      fail("joint ", s.joint(j), " still has status FOLLOWING ", when);
  }
}

// Where the joints are after small motions to a target and a rest there, against where they were
// before; `asked`: what the commands come to. share 0: the same time at rest, which shows what load
// and soft gains do alone.
struct Excursion {
  std::array<double, WB_DRIVER_MAX_JOINTS> moved{}, asked{};
  std::array<std::uint32_t, WB_DRIVER_MAX_JOINTS> status{};
};
Excursion excursion(Session& s, double share) {
  constexpr double kMoveS = 0.6;
  Excursion out;
  s.start();
  s.activate();
  s.watch(kSettleS, [&](double) { s.must_write(s.hold()); });
  const wb_readings from = s.readings();
  const wb_commands hold = s.hold();
  wb_commands last = hold;
  TimeNs then = s.now();
  const auto write = [&](const wb_commands& c) {
    s.must_write(c);
    for (std::uint32_t j = 0; j < s.joints(); ++j) {
      if (c.joints[j].kind == WB_CMD_VELOCITY)
        out.asked[j] += last.joints[j].velocity * to_seconds(s.now() - then);
      else
        out.asked[j] = c.joints[j].position - hold.joints[j].position;
    }
    last = c;
    then = s.now();
  };
  s.watch(kMoveS, [&](double t_s) { write(s.sweep(share * t_s)); });
  s.watch(kSettleS, [&](double) {
    wb_commands rest = s.sweep(share * kMoveS);
    for (auto& joint : rest.joints) joint.velocity = 0;
    write(rest);
  });
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    out.moved[j] = s.readings().joints[j].position - from.joints[j].position;
    out.status[j] = s.readings().joints[j].status;
  }
  return out;
}

// What the joints say of themselves must be true.
std::string follows(const Options& options) {
  constexpr double kLeast = 0.4, kMost = 1.6;  // shares of what was asked
  constexpr double kFar = 1e3;  // a soft joint that gravity pulls goes further: that is no fault
  Excursion still;
  {
    Session s(options);
    still = excursion(s, 0);
    s.deactivate();
  }
  Session s(options);
  const Excursion e = excursion(s, 1);
  double least = kFar, most = 0;
  std::uint32_t judged = 0;
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    const wb_command_kind kind = kind_of(s.description().joints[j]);
    if (kind == WB_CMD_TORQUE) continue;              // where that leads depends on the load
    if (e.status[j] != WB_JOINT_FOLLOWING) continue;  // see check "status"
    if (std::abs(e.asked[j]) < 2 * options.motion_tolerance) continue;  // too slow a joint
    const double moved = e.moved[j] - still.moved[j], share = moved / e.asked[j];
    if (!(share >= kLeast && share <= (kind == WB_CMD_IMPEDANCE ? kFar : kMost)))
      fail("joint ", s.joint(j), " has status FOLLOWING, but moved by ", moved, " when ",
           e.asked[j], " was commanded");
    least = std::min(least, share);
    most = std::max(most, share);
    ++judged;
  }
  if (judged == 0) return "no joint takes positions or velocities";
  return std::to_string(judged) + " joints moved by " + text_of(least) + " to " + text_of(most) +
         " of what was commanded";
}

// After the joints were stopped: the latch holds, whatever is written.
void must_be_latched(Session& s, const std::string& by) {
  s.rest(kSettleS);
  must_be_halted(s, by);
  s.must_stand_still(0.3, by + ", while commands were written", [&](double t_s) {
    if (const wb_status got = s.write(s.sweep(t_s)); got != WB_TIMED_OUT)
      fail("write ", by, " returned ", got, ", not WB_TIMED_OUT");
  });
  s.deactivate();
  s.must_stand_still(0.1, by + " and deactivate", [](double) {});
  s.activate();
  s.must_write(s.hold());
  s.tick();
  s.must_read();
  if (s.readings().timed_out) fail("timed_out is still set after the next activate");
}

std::string time_out(const Options& options) {
  Session s(options);
  s.start();
  s.activate();
  sweep(s, 0.3);
  s.must_write(s.sweep(0.3));
  const TimeNs written = s.now();
  const TimeNs patience = s.timeout_ns() + (s.steps() ? 4 * s.period_ns() : 200'000'000);
  TimeNs silence = 0;
  do {
    s.tick();
    s.must_read();
    silence = s.now() - written;
    if (silence > patience && !s.readings().timed_out)
      fail("timed_out is not set ", 1e3 * to_seconds(silence),
           " ms after the last write, the time-out is ", 1e3 * to_seconds(s.timeout_ns()), " ms");
  } while (!s.readings().timed_out);
  if (silence < s.timeout_ns() - s.slack_ns())
    fail("timed_out is set ", 1e3 * to_seconds(silence), " ms after the last write, before the ",
         1e3 * to_seconds(s.timeout_ns()), " ms given to activate");
  must_be_latched(s, "after the time-out");
  return "timed out " + text_of(1e3 * to_seconds(silence)) + " ms after the last write, given " +
         text_of(1e3 * to_seconds(s.timeout_ns())) + " ms";
}

// The first half of process_dies: the positions at the last moment before the process ends.
std::string move_and_die(const Options& options) {
  auto* s = new Session(options);  // nobody destroys it: the process just ends
  s->start();
  if (s->steps()) throw Skipped{"the plugin can step: nothing moves on when its host is dead"};
  s->activate();
  sweep(*s, 0.5);
  std::string positions;
  for (std::uint32_t j = 0; j < s->joints(); ++j)
    positions += std::to_string(s->readings().joints[j].position) + " ";
  return positions;
}

std::string process_dies(const Options& options) {
  const Result died = in_child({"", "", move_and_die}, options);
  if (died.outcome == Outcome::kSkipped) throw Skipped{died.reason};
  if (died.outcome == Outcome::kFailed) throw Failed{died.reason};
  const double dead_s = 1e-3 * options.timeout_ms + 3;
  const TimeNs dead_ns = from_seconds(dead_s);
  const timespec wait{dead_ns / kNanosPerSecond, dead_ns % kNanosPerSecond};
  clock_nanosleep(CLOCK_MONOTONIC, 0, &wait, nullptr);
  Session s(options);
  s.start();
  std::istringstream positions(died.reason);
  double most = 0;
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    double then = 0;
    positions >> then;
    const double moved = std::abs(s.readings().joints[j].position - then);
    // 0.1 rad/s at most, until the time-out and then a ramp.
    const double allowed = options.motion_tolerance + 0.1 * (1e-3 * options.timeout_ms + 1);
    if (!(moved <= allowed))
      fail("joint ", s.joint(j), " moved by ", moved, " in the ", dead_s,
           " s after the process that commanded it had died, allowed ", allowed);
    most = std::max(most, moved);
  }
  return "moved by " + text_of(most) + " at most";
}

std::string stop(const Options& options) {
  Session s(options);
  s.start();
  s.activate();
  sweep(s, 0.3);
  if (const wb_status got = s.stop(); got != WB_OK) fail("stop returned ", got);
  must_be_latched(s, "after stop");
  return "";
}

std::string deactivate(const Options& options) {
  Session s(options);
  s.start();
  s.activate();
  sweep(s, 0.3);
  s.deactivate();
  s.rest(kSettleS);
  must_be_halted(s, "after deactivate");
  s.must_stand_still(0.3, "after deactivate", [](double) {});
  return "";
}

// Writes bad(i) before every proper command and compares the motion with that of proper commands
// alone: what the joints do under those is not the question.
template <class Bad>
void must_change_nothing(Session& s, const std::string& what, int count, Bad&& bad) {
  const auto hold = [&](double) { s.must_write(s.hold()); };
  s.watch(kSettleS, hold);
  const double seconds = std::max(0.2, 2.0 * count / s.options().rate_hz);
  const double allowed = s.options().motion_tolerance + 2.0 * s.watch(seconds, hold).distance;
  int i = 0;
  const Session::Motion m = s.watch(seconds, [&](double t_s) {
    if (i < count) bad(i++);
    hold(t_s);
  });
  while (i < count) bad(i++);  // a slow machine: the rest without looking
  if (m.distance > allowed)
    fail("joint ", s.joint(m.joint), " moved by ", m.distance, " under ", what, ", allowed ",
         allowed);
}

std::string not_finite(const Options& options) {
  Session s(options);
  s.start();
  if (s.joints() == 0) return "no joints";
  s.activate();
  constexpr double kValues[] = {std::numeric_limits<double>::quiet_NaN(),
                                std::numeric_limits<double>::infinity(),
                                -std::numeric_limits<double>::infinity()};
  constexpr const char* kFields[] = {"position", "velocity", "effort", "stiffness", "damping"};
  const int count = static_cast<int>(s.joints()) * 15;
  must_change_nothing(s, "commands that are not finite", count, [&](int i) {
    const auto j = static_cast<std::uint32_t>(i / 15);
    wb_commands c = s.hold();
    double* const fields[] = {&c.joints[j].position, &c.joints[j].velocity, &c.joints[j].effort,
                              &c.joints[j].stiffness, &c.joints[j].damping};
    const double value = kValues[i % 15 / 5];
    // Which fields mean something depends on the kind; the others may be anything.
    const wb_command_kind kind = kind_of(s.description().joints[j]);
    const int field = i % 5;
    const bool used = kind == WB_CMD_IMPEDANCE || (kind == WB_CMD_POSITION && field < 3) ||
                      (kind == WB_CMD_VELOCITY && field == 1) ||
                      (kind == WB_CMD_TORQUE && field == 2);
    *fields[field] = value;
    const wb_status got = s.write(c);
    if (used && got == WB_OK)
      fail("write accepted ", value, " as ", kFields[field], " of joint ", s.joint(j));
  });
  return std::to_string(count) + " commands";
}

std::string unsupported_kinds(const Options& options) {
  Session s(options);
  s.start();
  std::vector<std::pair<std::uint32_t, std::uint32_t>> cases;
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    for (const std::uint32_t k : {1u, 2u, 3u, 4u, 5u, 1u << 20}) {
      if (k > WB_CMD_TORQUE || !(s.description().joints[j].command_kinds & (1u << k)))
        cases.emplace_back(j, k);
    }
  }
  if (cases.empty()) return "no joints";
  s.activate();
  must_change_nothing(
      s, "commands of kinds that it does not support", static_cast<int>(cases.size()), [&](int i) {
        const auto [j, k] = cases[i];
        wb_commands c = s.hold();
        c.joints[j].kind = k;
        c.joints[j].velocity = 0.1 * s.description().joints[j].velocity_max;
        if (s.write(c) == WB_OK)
          fail("write accepted command kind ", k, " for joint ", s.joint(j),
               ", which supports the bits ", s.description().joints[j].command_kinds);
      });
  return std::to_string(cases.size()) + " commands";
}

std::string limits(const Options& options) {
  Session s(options);
  s.start();
  s.activate();
  const auto check = [&](const std::string& after) {
    for (std::uint32_t j = 0; j < s.joints(); ++j) {
      const wb_joint_info& info = s.description().joints[j];
      const auto& r = s.readings().joints[j];
      const std::string joint = "joint " + s.joint(j);
      if (std::abs(r.velocity) > 1.1 * info.velocity_max + s.options().motion_tolerance)
        fail(joint, " runs at ", r.velocity, after, ", velocity_max is ", info.velocity_max);
      if (std::abs(r.effort) > 1.1 * info.effort_max)
        fail(joint, " pulls with ", r.effort, after, ", effort_max is ", info.effort_max);
      if (info.position_min < info.position_max &&
          (r.position < info.position_min - s.options().motion_tolerance ||
           r.position > info.position_max + s.options().motion_tolerance))
        fail(joint, " stands at ", r.position, after, ", its range is ", info.position_min, " to ",
             info.position_max);
    }
  };
  s.watch(kSettleS, [&](double) { s.must_write(s.hold()); });
  for (std::uint32_t j = 0; j < s.joints(); ++j) {
    const wb_joint_info& info = s.description().joints[j];
    wb_commands c = s.hold();
    const wb_command_kind kind = kind_of(info);
    std::string field = "effort";
    if (kind == WB_CMD_VELOCITY) {
      field = "velocity";
      c.joints[j].velocity = 10 * info.velocity_max;
    } else if (kind == WB_CMD_POSITION && info.position_min < info.position_max) {
      field = "position";
      c.joints[j].position = info.position_max + 1.0;
    } else {
      c.joints[j].effort = 10 * info.effort_max;
    }
    // Refused or clipped, as the plugin likes.
    (void)s.write(c);
    for (int i = 0; i < 20; ++i) {
      s.tick();
      s.must_read();
      check(" after a command beyond its " + field + " limit for joint " + s.joint(j));
      s.must_write(s.hold());
    }
  }
  return "";
}

}  // namespace

std::vector<Check> motion_checks() {
  return {
      {"still_until_written", "Nothing moves between activate and the first write.",
       still_until_written},
      {"follows", "Joints that say that they follow move as they are commanded.", follows},
      {"time_out",
       "When commands cease the joints stop in time, and stay so until the next activate.",
       time_out},
      {"process_dies",
       "When the process that commands dies, the joints stop, with nobody left to tell them.",
       process_dies},
      {"stop", "stop halts the joints, and they stay so until the next activate.", stop},
      {"deactivate", "deactivate halts the joints.", deactivate},
      {"not_finite", "Commands with NaN or infinity are refused, and nothing moves by them.",
       not_finite},
      {"unsupported_kinds",
       "Command kinds that a joint does not support are refused, and nothing moves by them.",
       unsupported_kinds},
      {"limits", "Commands beyond a joint's limits are refused or clipped.", limits},
  };
}

}  // namespace wb::check
