// The CAN fault suite as figures: every row of drivers/can/faults on the in-process bus and its
// virtual clock, and what one cycle of six drives costs (thread CPU, equivalent time).
//
//   build/release/bench/faults --json FILE
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/equivalent_time.hpp"
#include "bench/figures.hpp"
#include "drivers/can/faults/fault_rows.hpp"

namespace {

using namespace wb;
using namespace wb::bench;

// One control tick of the driver alone: cycle of six drives, collecting their answers, read, write.
// The bus and its drives run outside the measurement.
class TimedPacer final : public can::Pacer {
 public:
  TimedPacer(can::InProcessBus& bus, double& outside_ms) : bus_(bus), outside_ms_(outside_ms) {}
  TimeNs bus_time() const RT_SAFE override { return bus_.now(); }
  bool advance(const can::Tick& tick) RT_SAFE override {
    const double before = thread_cpu_ms();
    bus_.advance(tick.bus_ns);
    outside_ms_ += thread_cpu_ms() - before;
    return true;
  }

 private:
  can::InProcessBus& bus_;
  double& outside_ms_;
};

double cycle_us(double fraction) {
  can::RigOptions options;
  options.drives = 6;
  options.supervision.velocity_every = 8;  // six drives on one bus at 400 Hz: 68 %
  can::Rig rig(options);
  double outside_ms = 0;
  TimedPacer pacer(*rig.buses.front(), outside_ms);
  can::CanDriver driver(rig.driver->config(), {rig.ports.front().get()}, &pacer);
  if (driver.configure() != WB_OK) throw std::runtime_error("six drives were not set up");
  const std::vector<wb_timeout_action> actions(6, WB_TIMEOUT_HOLD);
  wb_readings readings{};
  wb_commands commands{};
  (void)driver.advance(0);
  if (driver.activate(50'000'000, actions.data()) != WB_OK)
    throw std::runtime_error("six drives were not activated");
  Sweep sweep;
  std::vector<double> cycles, sweeps;
  double checksum = 0;
  constexpr int kWarm = 100, kCycles = 4000, kSweepEvery = 20;
  for (int k = 1; k <= kWarm + kCycles; ++k) {
    const TimeNs t = k * can::Rig::kPeriod;
    outside_ms = 0;
    const double before = thread_cpu_ms();
    (void)driver.advance(t);
    (void)driver.read(readings);
    commands.t_ns = t;
    for (int i = 0; i < 6; ++i) {
      commands.joints[i].kind = WB_CMD_POSITION;
      commands.joints[i].position = 0.1 * i;
    }
    const wb_status written = driver.write(commands);
    const double spent = thread_cpu_ms() - before - outside_ms;
    if (k <= kWarm) continue;
    if (written != WB_OK) throw std::runtime_error("a command was refused");
    cycles.push_back(spent);
    if (k % kSweepEvery) continue;
    const double start = thread_cpu_ms();
    checksum += sweep.run();
    sweeps.push_back(thread_cpu_ms() - start);
  }
  for (int i = 0; i < 6; ++i) {
    if (readings.joints[i].status != WB_JOINT_FOLLOWING)
      throw std::runtime_error("a drive does not follow");
  }
  std::fprintf(stderr, "sweep median %.3f ms (checksum %.6g)\n", quantile(sweeps, 0.5), checksum);
  return 1e3 * quantile(cycles, fraction) * kSweepReferenceMs / quantile(sweeps, 0.5);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"CAN fault suite"};
  std::string json;
  app.add_option("--json", json, "file for the figures");
  CLI11_PARSE(app, argc, argv);
  try {
    std::vector<Figure> rows;
    int passed = 0, moved = 0;
    double worst_ms = 0;
    std::printf("%-4s %-44s %-20s %9s %9s  %s\n", "no.", "fault", "noticed as", "ms", "bound", "");
    for (const can::FaultRow& row : can::fault_rows()) {
      const can::FaultResult r = can::run_fault(row);
      passed += r.passed();
      moved += r.moved_rad > 1e-6;
      // Time-outs of set-up and the watch of a hanging controller are not reactions to a moving
      // robot.
      if (row.reaction == can::Reaction::kStop) worst_ms = std::max(worst_ms, r.detection_ms);
      std::printf("%-4s %-44s %-20s %9.1f %9.1f  %s\n", row.number.c_str(), row.fault,
                  r.event.c_str(), r.detection_ms, row.bound_ms, r.passed() ? "passed" : "FAILED");
      rows.push_back({"row_" + row.number + "_detection_ms",
                      r.passed() ? r.detection_ms : row.bound_ms + 1e6, "ms virtual", row.bound_ms,
                      Better::kLower});
    }
    const auto n = static_cast<double>(can::fault_rows().size());
    std::vector<Figure> figures = {
        {"fault_rows", n, "", 30, Better::kHigher},
        {"fault_rows_passed", static_cast<double>(passed), "", n, Better::kHigher},
        {"moved_after_fault", static_cast<double>(moved), "rows", 0, Better::kLower},
        {"worst_detection_ms", worst_ms, "ms virtual", 1200, Better::kLower},
        {"can_cycle_6_drives_us", cycle_us(0.5), "us", 50, Better::kLower},
        {"can_cycle_6_drives_p99_us", cycle_us(0.99), "us", std::nullopt, Better::kLower},
    };
    figures.insert(figures.end(), rows.begin(), rows.end());
    print_table(figures);
    if (!json.empty()) write_json(figures, json);
    return all_hold(figures) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "faults: %s\n", error.what());
    return 1;
  }
}
