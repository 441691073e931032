#include <algorithm>
#include <cmath>
#include <cstdio>

#include "drivers/can/faults/fault_rows.hpp"

namespace wb::can {
namespace {

constexpr double kSettle_s = 0.5;  // quick stop from the suite's speeds, and its brakes
constexpr double kStill_rad = 1e-6;
// Drives that were set up in half a second of silence are found again within this time.
constexpr double kReturn_s = 4.0;

double largest_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double d = 0;
  for (std::size_t i = 0; i < a.size(); ++i) d = std::max(d, std::abs(a[i] - b[i]));
  return d;
}

bool expected(const FaultRow& row, int event) {
  return std::any_of(row.events.begin(), row.events.end(),
                     [&](Event e) { return static_cast<int>(e) == event; });
}

std::uint64_t counted(const FaultRow& row, const Rig& rig) {
  std::uint64_t n = 0;
  for (const Event e : row.events) n += rig.driver->count(e);
  return n;
}

bool logged(const FaultRow& row, const Rig& rig, std::size_t from) {
  return std::any_of(row.events.begin(), row.events.end(), [&](Event e) {
    return rig.log().find(text_of(e).text, from) != std::string::npos;
  });
}

// Deactivate, wait until the drives are there, activate, move.
bool recover(Rig& rig) {
  (void)rig.driver->deactivate();
  rig.run(0.1);
  bool active = false;
  rig.run(kReturn_s, [&] {
    active = rig.activate() == WB_OK;
    return !active;
  });
  if (!active) return false;
  const auto before = rig.positions();
  rig.run(1.0);
  return rig.all_follow() && largest_difference(before, rig.positions()) > 0.01;
}

std::vector<std::uint64_t> enabling_rpdos(const Rig& rig) {
  std::vector<std::uint64_t> n;
  for (const auto& s : rig.sniffers) n.push_back(s->enabling);
  return n;
}

// Commands go on while the latch holds: nothing may move, before and after the repair.
// enabling: RPDOs that enabled, up to the stop: none may follow.
void check_latch(const FaultRow& row, Rig& rig, const std::vector<std::uint64_t>& enabling,
                 FaultResult& r) {
  bool refused = true;
  const auto watch = [&] {
    const bool asks = rig.commanding && rig.driver->state() == WB_ACTIVE;
    refused = refused && (!asks || rig.written == WB_TIMED_OUT);
    return true;
  };
  const auto stopped_at = rig.positions();
  rig.run(0.5, watch);
  if (row.repair) row.repair(rig);
  rig.run(1.0, watch);
  r.moved_rad = largest_difference(stopped_at, rig.positions());
  bool none_enabling = true;
  for (std::size_t i = 0; i < enabling.size(); ++i)
    none_enabling = none_enabling && rig.sniffers[i]->enabling == enabling[i];
  r.latched = refused && none_enabling && r.moved_rad <= kStill_rad && rig.none_follows();
  if (!refused) r.note += "a write was taken after the stop; ";
  if (!none_enabling) r.note += "an enabling RPDO left after the stop; ";
}

FaultResult run_stop(const FaultRow& row, Rig& rig) {
  FaultResult r;
  if (!rig.start()) {
    r.note = "did not start\n" + rig.log();
    return r;
  }
  const std::size_t log_from = rig.log().size();
  const std::uint64_t count_before = counted(row, rig);
  const TimeNs injected = rig.now();
  row.inject(rig);
  const bool holds = !row.holds || row.holds(rig);
  rig.run(1e-3 * row.bound_ms + 0.5, [&] { return rig.driver->stop_event() < 0; });
  const auto enabling = enabling_rpdos(rig);
  r.detection_ms = 1e3 * to_seconds(rig.now() - injected);
  if (rig.driver->stop_event() >= 0)
    r.event = text_of(static_cast<Event>(rig.driver->stop_event())).name;
  r.detected = expected(row, rig.driver->stop_event()) && r.detection_ms <= row.bound_ms;
  rig.run(kSettle_s);
  r.reacted = holds && rig.none_follows() && !rig.any_enabled() && rig.readings.timed_out;
  r.counted = counted(row, rig) > count_before;
  r.logged = logged(row, rig, log_from);
  check_latch(row, rig, enabling, r);
  r.recovered = recover(rig);
  return r;
}

FaultResult run_go_on(const FaultRow& row, Rig& rig) {
  FaultResult r;
  if (!rig.start()) {
    r.note = "did not start\n" + rig.log();
    return r;
  }
  const std::size_t log_from = rig.log().size();
  const std::uint64_t count_before = counted(row, rig);
  const TimeNs injected = rig.now();
  row.inject(rig);
  rig.run(1e-3 * row.bound_ms + 0.1,
          [&] { return !row.events.empty() && counted(row, rig) == count_before; });
  if (row.events.empty()) rig.tick();
  r.detection_ms = row.events.empty() ? 0 : 1e3 * to_seconds(rig.now() - injected);
  r.counted = counted(row, rig) > count_before || row.events.empty();
  r.detected = r.counted && r.detection_ms <= row.bound_ms;
  for (const Event e : row.events) {
    if (rig.driver->count(e) > 0 && r.event.empty()) r.event = text_of(e).name;
  }
  const auto before = rig.positions();
  rig.run(0.5);
  r.reacted = rig.driver->stop_event() < 0 && rig.all_follow() &&
              largest_difference(before, rig.positions()) > 0.01;
  r.latched = true;  // nothing to latch
  r.logged = logged(row, rig, log_from) || row.events.empty();
  if (row.repair) row.repair(rig);
  rig.run(0.5);
  r.recovered = rig.all_follow() && (!row.holds || row.holds(rig));
  return r;
}

FaultResult run_refuse(const FaultRow& row, Rig& rig) {
  FaultResult r;
  const auto before = rig.positions();
  row.inject(rig);
  const TimeNs start = rig.buses.front()->now();
  const bool refused = rig.driver->configure() != WB_OK;
  r.counted = counted(row, rig) > 0;
  rig.tick();  // drains the log
  r.logged = logged(row, rig, 0);
  r.detection_ms = 1e3 * to_seconds(rig.buses.front()->now() - start);
  r.detected = r.counted && r.detection_ms <= row.bound_ms;
  for (const Event e : row.events) {
    if (rig.driver->count(e) > 0 && r.event.empty()) r.event = text_of(e).name;
  }
  r.reacted = refused && rig.activate() == WB_BAD_STATE && !rig.any_enabled();
  r.moved_rad = largest_difference(before, rig.positions());
  r.latched = r.moved_rad <= kStill_rad && rig.sniffers.front()->enabling == 0;
  if (row.repair) {
    row.repair(rig);
    r.recovered = rig.start();
  } else {
    r.recovered = true;  // by another configuration only; the row says so
  }
  return r;
}

FaultResult run_no_enable(const FaultRow& row, Rig& rig) {
  FaultResult r;
  row.inject(rig);
  if (rig.driver->configure() != WB_OK) {
    r.note = "could not be configured\n" + rig.log();
    return r;
  }
  rig.run(0.1);
  const auto before = rig.positions();
  const std::uint64_t count_before = counted(row, rig);
  const TimeNs start = rig.now();
  bool followed = false;
  (void)rig.activate();
  rig.run(1e-3 * row.bound_ms + 0.5, [&] {
    for (int i = 0; i < rig.joints(); ++i)
      followed = followed || (i == 0 && rig.readings.joints[i].status == WB_JOINT_FOLLOWING);
    return rig.driver->stop_event() < 0;
  });
  const auto enabling = enabling_rpdos(rig);
  r.detection_ms = 1e3 * to_seconds(rig.now() - start);
  if (rig.driver->stop_event() >= 0)
    r.event = text_of(static_cast<Event>(rig.driver->stop_event())).name;
  r.detected = expected(row, rig.driver->stop_event()) && r.detection_ms <= row.bound_ms;
  rig.run(kSettle_s);
  r.reacted = !followed && rig.none_follows() && !rig.any_enabled();
  check_latch(row, rig, enabling, r);
  r.moved_rad = std::max(r.moved_rad, largest_difference(before, rig.positions()));
  r.latched = r.latched && r.moved_rad <= kStill_rad;
  r.counted = counted(row, rig) > count_before;
  r.logged = logged(row, rig, 0);
  r.recovered = row.repair ? recover(rig) : true;
  return r;
}

}  // namespace

FaultResult run_fault(const FaultRow& row) {
  Rig rig(row.options);
  switch (row.reaction) {
    case Reaction::kStop:
      return run_stop(row, rig);
    case Reaction::kGoOn:
      return run_go_on(row, rig);
    case Reaction::kRefuse:
      return run_refuse(row, rig);
    case Reaction::kNoEnable:
      return run_no_enable(row, rig);
  }
  return {};
}

std::string fault_table() {
  const auto reaction = [](Reaction r) {
    return r == Reaction::kStop     ? "all drives stop, latched"
           : r == Reaction::kGoOn   ? "counted and logged, goes on"
           : r == Reaction::kRefuse ? "configure fails"
                                    : "activate ends in the latch";
  };
  std::string table =
      "| no. | fault | injected by | noticed as | within | reaction | way out |\n"
      "|---|---|---|---|---|---|---|\n";
  for (const FaultRow& row : fault_rows()) {
    std::string events;
    for (const Event e : row.events)
      events += (events.empty() ? "`" : ", `") + std::string(text_of(e).name) + "`";
    char bound[32];
    std::snprintf(bound, sizeof bound, "%g ms", row.bound_ms);
    if (row.events.empty()) events = "-";
    table += "| " + row.number + " | " + row.fault + " | " + row.injection + " | " + events +
             " | " + bound + " | " + reaction(row.reaction) + " | " + row.recovery + " |\n";
  }
  table += "\nNot covered by this suite:\n\n| no. | fault | why |\n|---|---|---|\n";
  for (const NotCovered& n : faults_not_covered())
    table += "| " + std::to_string(n.number) + " | " + n.fault + " | " + n.why + " |\n";
  return table;
}

}  // namespace wb::can
