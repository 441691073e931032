// wholebodyd: the daemon. Reads its configuration, builds the system, runs its loops in real time or in lockstep, serves DDS.
#include <CLI/CLI.hpp>
#include <spdlog/async.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/mman.h>

#include <atomic>
#include <csignal>
#include <fstream>

#include "core/rt/executor.hpp"
#include "daemon/pacing.hpp"
#include "daemon/recording.hpp"
#include "daemon/real_time_report.hpp"
#include "daemon/serving.hpp"
#include "daemon/system.hpp"
#include "daemon/service/systemd_notify.hpp"

namespace {

std::atomic<bool> stopping{false};
void on_signal(int) { stopping = true; }

struct Options {
  std::string config;
  std::string record;
  bool lockstep = false, truth = false, free_running = false;
  std::string plugin_folder = WB_PLUGIN_DIR;
};

// Virtual clock, paced to at most real time; it stands still until the first request is accepted (DEFINITIONS.md, "Lockstep").
void run_lockstep(wb::System& system, wb::Serving& serving, wb::RecordingWriter* recorder, bool paced) {
  if (!system.host().can_step()) throw std::runtime_error("--lockstep needs drivers that can be stepped");
  wb::Lockstep lockstep([&](wb::TimeNs t) { system.advance(t); });
  for (wb::Loop& loop : system.loops()) lockstep.add(std::move(loop));
  serving.show_counters([&](wb::ServiceSnapshot& s) { wb::add_loops(lockstep, s); });
  wb::Pacer pacer;
  const wb::TimeNs watchdog = wb::systemd::watchdog_period_ns();
  wb::systemd::ready();
  wb::TimeNs fed = 0;
  while (!stopping) {
    if (watchdog && wb::RealTime::monotonic() - fed > watchdog) {
      wb::systemd::watchdog();
      fed = wb::RealTime::monotonic();
    }
    if (!serving.started()) {
      wb::sleep_ns(2'000'000);
      pacer.restart(lockstep.now());
      continue;
    }
    const wb::TimeNs now = lockstep.run_next();
    serving.set_time(now);
    if (recorder) recorder->drain(system.arrows());
    if (paced) pacer.wait(now);
  }
  serving.show_counters({});  // the executor goes with this function
}

void run_real_time(wb::System& system, wb::Serving& serving, wb::RecordingWriter* recorder) {
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) spdlog::warn("memory cannot be locked: {}", std::strerror(errno));
  // A simulated plant needs somebody to advance it: the control loop does, before it reads.
  const bool simulated = system.host().can_step();
  system.advance_in_control(simulated);
  wb::RealTime executor(simulated ? wb::RealTime::monotonic() : 0);
  serving.use_clock([&] { return executor.now(); });
  for (wb::Loop& loop : system.loops()) executor.add(std::move(loop));
  serving.show_counters([&](wb::ServiceSnapshot& s) { wb::add_loops(executor, s); });
  wb::RealTimeReport report;
  for (const std::string& name : executor.start()) spdlog::warn("loop {} did not get its real-time priority", name);
  wb::systemd::ready();
  // The watchdog is fed only while control keeps running.
  const wb::TimeNs watchdog = wb::systemd::watchdog_period_ns();
  std::uint64_t cycles = 0;
  wb::TimeNs fed = 0;
  while (!stopping) {
    wb::sleep_ns(10'000'000);
    if (recorder) recorder->drain(system.arrows());
    if (watchdog && wb::RealTime::monotonic() - fed > watchdog && executor.counters(0).cycles.load() != cycles) {
      cycles = executor.counters(0).cycles.load();
      fed = wb::RealTime::monotonic();
      wb::systemd::watchdog();
    }
  }
  executor.stop();
  serving.set_time(executor.now());
  serving.use_clock({});  // the executor goes with this function
  serving.show_counters({});
  report.print(executor);
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  CLI::App app{"Whole-body controller daemon for mobile manipulators"};
  app.add_option("--config", o.config, "configuration file (wholebodyd.yaml)")->required()->check(CLI::ExistingFile);
  app.add_flag("--lockstep", o.lockstep, "virtual clock, deterministic; needs steppable drivers");
  app.add_flag("--free-running", o.free_running, "with --lockstep: as fast as it goes instead of at most real time");
  app.add_option("--record", o.record, "write what every step was handed to this file (for wbctl replay)");
  app.add_flag("--truth", o.truth, "publish the simulator's ground truth");
  app.add_option("--plugins", o.plugin_folder, "folder of the driver plugins")->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  try {
    spdlog::init_thread_pool(8192, 1);
    spdlog::set_default_logger(spdlog::create_async<spdlog::sinks::stderr_color_sink_mt>("wholebodyd"));
    const auto log = [](wb_log_level level, const std::string& text) {
      constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::debug, spdlog::level::info, spdlog::level::warn,
                                                       spdlog::level::err};
      spdlog::log(kLevels[level], "{}", text);
    };
    const wb::DaemonConfig config = wb::DaemonConfig::load(o.config, o.plugin_folder);
    wb::System system(config, log);
    std::unique_ptr<wb::RecordingWriter> recorder;
    if (!o.record.empty()) {
      recorder = std::make_unique<wb::RecordingWriter>(o.record, config.robot, config.disabled_terms);
      system.record_steps();
    }
    wb::Serving serving(system, o.truth);
    spdlog::info("robot {}, {}", system.model().config().name, o.lockstep ? "lockstep" : "real time");
    if (o.lockstep) {
      run_lockstep(system, serving, recorder.get(), !o.free_running);
    } else {
      run_real_time(system, serving, recorder.get());
    }
    wb::systemd::stopping();
    if (recorder) {
      recorder->drain(system.arrows());
      if (recorder->failed()) spdlog::error("the recording is incomplete: the disk refused a write");
    }
    spdlog::info("state hash {:016x}", system.state_hash());
    spdlog::shutdown();
    return 0;
  } catch (const std::exception& e) {
    spdlog::error("{}", e.what());
    spdlog::shutdown();
    return 1;
  }
}
