#include <cmath>
#include <limits>

#include "core/rt/allocation_count.hpp"
#include "drivers/check/checks.hpp"

namespace wb::check {
namespace {

// Every port in every situation: inactive, commanded, refused, silent, stopped.
void exercise(Session& s) {
  s.start();
  s.rest(0.1);
  s.activate();
  s.rest(0.02);
  s.watch(0.2, [&](double t_s) { (void)s.write(s.sweep(t_s)); });
  s.watch(0.05, [&](double) {
    wb_commands bad = s.hold();
    for (std::uint32_t j = 0; j < s.joints(); ++j)
      bad.joints[j].position = bad.joints[j].velocity = bad.joints[j].effort =
          std::numeric_limits<double>::quiet_NaN();
    (void)s.write(bad);
    (void)s.write(s.hold());
  });
  s.rest(to_seconds(s.timeout_ns()) + 0.1);
  s.watch(0.05, [&](double) { (void)s.write(s.hold()); });  // after the time-out
  s.deactivate();
  (void)s.write(s.hold());
  s.activate();
  (void)s.write(s.hold());
  (void)s.stop();
  s.watch(0.05, [&](double) { (void)s.write(s.hold()); });
  s.deactivate();
}

std::string no_allocation(const Options& options) {
  if (!allocations_are_counted()) throw Skipped{"a sanitizer owns malloc"};
  Session s(options);
  exercise(s);
  for (const Port p : {kRead, kWrite, kStop}) {
    const PortUse& use = s.use()[p];
    if (use.allocations)
      fail(kPortNames[p], " allocated ", use.allocations, " times in ", use.calls, " calls");
  }
  std::string out;
  for (int p = 0; p < kPorts; ++p) {
    const PortUse& use = s.use()[p];
    if (!use.calls) continue;
    out += (out.empty() ? "" : "; ") + std::string(kPortNames[p]) + " at most " +
           text_of(1e-3 * use.cpu_max_ns) + " us CPU, " + text_of(1e-3 * use.wall_max_ns) +
           " us wall";
    if (use.allocations) out += ", " + std::to_string(use.allocations) + " allocations";
  }
  return out;
}

std::string no_log(const Options& options) {
  Session s(options);
  exercise(s);
  for (int p = 0; p < kPorts; ++p) {
    const PortUse& use = s.use()[p];
    if (use.log_lines)
      fail(kPortNames[p], " called the log ", use.log_lines, " times in ", use.calls,
           " calls: ", s.newest_line());
  }
  return "";
}

}  // namespace

std::vector<Check> port_checks() {
  return {
      {"ports_allocate_nothing",
       "read, write and stop make no heap allocation (times and advance: reported only).",
       no_allocation},
      {"ports_do_not_log", "No log line comes from within read, write, stop or advance.", no_log},
  };
}

}  // namespace wb::check
