// wholebodyd: the daemon. Reads its configuration, builds the system, runs its loops in real time
// or in lockstep, serves DDS.
#include <spdlog/async.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <sys/mman.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstring>
#include <memory>
#include <optional>

#include "core/rt/executor.hpp"
#include "daemon/observed_run.hpp"
#include "daemon/pacing.hpp"
#include "daemon/plugin_folder.hpp"
#include "daemon/real_time_report.hpp"
#include "daemon/recording.hpp"
#include "daemon/service/systemd_notify.hpp"
#include "daemon/serving.hpp"
#include "daemon/system.hpp"

namespace {

std::atomic<bool> stopping{false};
void on_signal(int) { stopping = true; }

struct Options {
  std::string config;
  std::string record;
  std::string observe, object;
  bool lockstep = false, truth = false, free_running = false;
  std::string plugin_folder = wb::default_plugin_folder();
};

// What the loops run in besides themselves.
struct Daemon {
  const Options& options;
  wb::System& system;
  wb::RecordingWriter* recorder;  // or null
};

// Tells systemd that the daemon is alive, often enough; only while `cycles` of control keep coming.
class Watchdog {
 public:
  void feed(std::uint64_t cycles) {
    const wb::TimeNs now = wb::RealTime::monotonic();
    if (period_ == 0 || now - fed_ <= period_ || cycles == cycles_) return;
    cycles_ = cycles;
    fed_ = now;
    wb::systemd::watchdog();
  }

 private:
  const wb::TimeNs period_ = wb::systemd::watchdog_period_ns();
  wb::TimeNs fed_ = 0;
  std::uint64_t cycles_ = 0;
};

// Virtual clock, paced to at most real time; it stands still until the first request is accepted
// (DEFINITIONS.md, "Lockstep").
void run_lockstep(const Daemon& daemon) {
  wb::System& system = daemon.system;
  if (!system.host().can_step()) {
    throw std::runtime_error("--lockstep needs drivers that can be stepped");
  }
  std::optional<wb::ObservedRun> observed;
  if (!daemon.options.observe.empty()) {
    observed.emplace(system, daemon.options.object, daemon.options.observe);
  }
  wb::Lockstep lockstep([&](wb::TimeNs t) { system.advance(t); });
  for (wb::Loop& loop : system.loops()) lockstep.add(std::move(loop));
  std::atomic<wb::TimeNs> now{0};
  wb::Serving serving(
      system, daemon.options.truth, [&] { return now.load(); },
      [&](wb::ServiceSnapshot& s) { wb::add_loops(lockstep, s); });
  wb::Pacer pacer;
  Watchdog watchdog;
  wb::systemd::ready();
  std::uint64_t turns = 0;
  while (!stopping) {
    watchdog.feed(++turns);
    if (!serving.started()) {
      wb::sleep_ns(2'000'000);
      pacer.restart(lockstep.now());
      continue;
    }
    now = lockstep.run_next();
    if (daemon.recorder) daemon.recorder->drain(system.arrows());
    if (observed) observed->after_instant(now);
    if (!daemon.options.free_running) pacer.wait(now);
  }
}

void run_real_time(const Daemon& daemon) {
  wb::System& system = daemon.system;
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    spdlog::warn("memory cannot be locked: {}", std::strerror(errno));
  }
  // A simulated plant needs somebody to advance it: the control loop does, before it reads.
  const bool simulated = system.host().can_step();
  system.advance_in_control();
  wb::RealTime executor(simulated ? wb::RealTime::monotonic() : 0);
  for (wb::Loop& loop : system.loops()) executor.add(std::move(loop));
  wb::Serving serving(
      system, daemon.options.truth, [&] { return executor.now(); },
      [&](wb::ServiceSnapshot& s) { wb::add_loops(executor, s); });
  wb::RealTimeReport report;
  for (const std::string& name : executor.start()) {
    spdlog::warn("loop {} did not get its real-time priority", name);
  }
  Watchdog watchdog;
  wb::systemd::ready();
  while (!stopping) {
    wb::sleep_ns(10'000'000);
    if (daemon.recorder) daemon.recorder->drain(system.arrows());
    watchdog.feed(executor.counters(0).cycles.load());
  }
  executor.stop();
  report.print(executor);
}

void run(const Options& o) {
  const auto log = [](wb_log_level level, const std::string& text) {
    constexpr spdlog::level::level_enum kLevels[] = {spdlog::level::debug, spdlog::level::info,
                                                     spdlog::level::warn, spdlog::level::err};
    spdlog::log(kLevels[level], "{}", text);
  };
  const wb::DaemonConfig config = wb::DaemonConfig::load(o.config, o.plugin_folder);
  wb::System system(config, log);
  std::unique_ptr<wb::RecordingWriter> recorder;
  if (!o.record.empty()) {
    recorder = std::make_unique<wb::RecordingWriter>(o.record, config.robot, config.disabled_terms);
    system.record_steps();
  }
  spdlog::info("robot {}, {}", system.model().config().name, o.lockstep ? "lockstep" : "real time");
  const Daemon daemon{o, system, recorder.get()};
  o.lockstep ? run_lockstep(daemon) : run_real_time(daemon);
  wb::systemd::stopping();
  if (recorder) {
    recorder->drain(system.arrows());
    if (recorder->failed()) spdlog::error("the recording is incomplete: the disk refused a write");
  }
  if (o.truth) spdlog::info("truth: {}", system.truth()->summary());
  spdlog::info("state hash {:016x}", system.state_hash());
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  CLI::App app{"Whole-body controller daemon for mobile manipulators"};
  app.add_option("--config", o.config, "configuration file (wholebodyd.yaml)")->required();
  CLI::Option* lockstep = app.add_flag("--lockstep", o.lockstep,
                                       "virtual clock, deterministic; needs steppable drivers");
  app.add_flag("--free-running", o.free_running, "as fast as it goes instead of at most real time")
      ->needs(lockstep);
  app.add_option("--record", o.record,
                 "write what every step was handed to this file (for wbctl replay)");
  app.add_flag("--truth", o.truth,
               "publish the simulator's ground truth (rt/truth/...), and log it at the end");
  CLI::Option* object = app.add_option("--object", o.object, "what --observe watches");
  CLI::Option* observe =
      app.add_option("--observe", o.observe,
                     "watch requests to open --object: pictures, run.csv and summary.json in this "
                     "folder, a line on stdout at the end of each")
          ->needs(lockstep, object);
  object->needs(observe);
  app.add_option("--plugins", o.plugin_folder, "folder of the driver plugins")
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 1;
  }

  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  spdlog::init_thread_pool(8192, 1);
  spdlog::set_default_logger(
      spdlog::create_async<spdlog::sinks::stderr_color_sink_mt>("wholebodyd"));
  int code = 0;
  try {
    run(o);
  } catch (const std::exception& e) {
    spdlog::error("{}", e.what());
    code = 1;
  }
  spdlog::shutdown();
  return code;
}
