// The articulated-object study: opens an object in a simulated kitchen from random starts, in
// lockstep, and writes a JSON line a run. Deterministic: a run depends on its seed alone, not on
// the number of jobs. See --help, DEFINITIONS.md and docs/how-to/study.md.
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>

#include "bench/equivalent_time.hpp"
#include "bench/scene_noise.hpp"
#include "core/rt/executor.hpp"
#include "daemon/recording.hpp"
#include "daemon/run_observer.hpp"
#include "daemon/system.hpp"

namespace {

struct Options {
  std::string robot = "mabi_mobile", scene = "kitchen_line", object = "drawer_1",
              planner = "slq-wbc", json, until = "end", record, pictures;
  std::string config = WB_SOURCE_DIR "/config/wholebodyd.yaml";
  int runs = 1, jobs = 1;
  std::uint64_t seed = 0;
  double limit_s = 60;
  bool no_environment = false, verbose = false;
};

struct Line {
  int run = 0;
  std::uint64_t seed = 0;
  bool success = false;
  std::string failure;
  double final_time_s = 0;
  wb::RunResult result;
  std::uint64_t state_hash = 0;
  double cpu_us = 0;
  double mpc_p99_ms = 0, mapping_p99_ms = 0;  // equivalent

  std::string json() const {
    std::ostringstream out;
    char hash[24];
    std::snprintf(hash, sizeof hash, "%016lx", state_hash);
    out << "{\"run\": " << run << ", \"seed\": " << seed
        << ", \"success\": " << (success ? "true" : "false") << ", \"failure\": \"" << failure
        << "\", \"time_s\": ";
    if (result.opened) {
      out << result.time_s;
    } else {
      out << "null";
    }
    out << ", \"end_s\": " << final_time_s << ", \"ee_path_m\": " << result.ee_path_m
        << ", \"opened_fraction\": " << result.opened_fraction
        << ", \"min_clearance_m\": " << result.min_clearance_m
        << ", \"collisions\": " << result.collisions << ", \"first_collision\": \""
        << result.first_collision << "\", \"slip_m\": " << result.slip_m << ", \"state_hash\": \""
        << hash << "\", \"cpu_us\": " << static_cast<long>(cpu_us)
        << ", \"mpc_p99_ms\": " << mpc_p99_ms << ", \"mapping_p99_ms\": " << mapping_p99_ms << "}";
    return out.str();
  }
};

wb::DaemonConfig make_config(const Options& o, std::uint64_t seed) {
  const std::filesystem::path config_folder = std::filesystem::path(o.config).parent_path();
  wb::DaemonConfig c = wb::DaemonConfig::load(o.config, WB_PLUGIN_DIR);
  c.robot = config_folder / "robots" / o.robot;
  c.seed = seed;
  std::ostringstream plugin;
  plugin << "{robot: robots/" << o.robot << ", scene: scenes/" << o.scene << ".yaml, seed: " << seed
         << ", spawn: random}";
  c.drivers.at(0).config = plugin.str();
  c.blind = o.no_environment;
  return c;
}

// Where the hand is against its reference, and what the solver's terms cost: why a run goes as it
// goes.
void print_state(wb::System& system, wb::TimeNs now) {
  const wb::RobotState& s = system.state();
  const wb::RobotModel& model = system.model();
  wb::StateVector x(model.nx());
  for (int i = 0; i < model.base_dof(); ++i) x[i] = s.base[i];
  for (int i = 0; i < model.joints(); ++i) x[model.base_dof() + i] = s.q[i];
  wb::RobotModel::Data data;
  model.forward_kinematics(x.data(), data);
  const Eigen::Isometry3d X_WE = model.X_WF(model.end_effector(), data);
  double position = 0, rotation = 0;
  const wb::Reference& r = system.reference();
  if (r.ee[0].count > 0) {
    const Eigen::Isometry3d X_ref = r.ee[0].keyframes[0].X_WE.isometry();
    position = (X_WE.translation() - X_ref.translation()).norm();
    rotation = Eigen::AngleAxisd(X_WE.linear().transpose() * X_ref.linear()).angle();
  }
  const wb::SolveReport& report = system.solve_report();
  std::fprintf(stderr,
               "%8.3f s %-10s base %6.2f %6.2f %6.2f v %5.2f %5.2f hand off by %.4f m %.3f rad; %s "
               "step %.3f cost %.3g -> %.3g;",
               wb::to_seconds(now), std::string(to_string(s.phase)).c_str(), s.base[0], s.base[1],
               s.base[2], s.base_velocity[0], s.base_velocity[2], position, rotation,
               std::string(to_string(report.status)).c_str(), report.step, report.cost_before,
               report.cost_after);
  const auto terms = system.problem().terms();
  for (std::size_t i = 0; i < terms.size(); ++i) {
    if (report.terms.cost[i] > 1e-3)
      std::fprintf(stderr, " %s %.3g", std::string(terms[i]->name()).c_str(), report.terms.cost[i]);
  }
  // The spheres nearest to what the map holds.
  if (const wb::DistanceField* field = system.arrows().field.read()) {
    for (std::size_t i = 0; i < model.spheres().size(); ++i) {
      const wb::Sphere& sphere = model.spheres()[i];
      const Eigen::Vector3d p = data.X_WL[sphere.body] * sphere.centre;
      const double gap = field->distance(p) - sphere.radius;
      if (gap < 0.03)
        std::fprintf(stderr, " sphere %zu%s gap %.3f at %.2f %.2f %.2f", i,
                     sphere.masked ? " (masked)" : "", gap, p.x(), p.y(), p.z());
    }
  }
  std::fprintf(stderr, "\n");
}

Line run_one(const Options& o, int run) {
  Line line;
  line.run = run;
  line.seed = o.seed + run;
  const wb::DaemonConfig config = make_config(o, line.seed);
  wb::System system(config, [](wb_log_level level, const std::string& text) {
    if (level >= WB_LOG_WARN) std::fprintf(stderr, "%s\n", text.c_str());
  });
  wb::Lockstep lockstep([&](wb::TimeNs t) { system.advance(t); });
  // The loops whose latency is declared are timed in equivalent time: the sweep runs beside them,
  // now and then.
  wb::bench::EquivalentTimer mpc_timer, mapping_timer;
  for (wb::Loop& loop : system.loops()) {
    if (loop.name == "mpc") loop.step = mpc_timer.wrap(std::move(loop.step));
    if (loop.name == "mapping") loop.step = mapping_timer.wrap(std::move(loop.step));
    lockstep.add(std::move(loop));
  }
  std::unique_ptr<wb::RecordingWriter> recorder;
  if (!o.record.empty()) {
    const std::string file = o.runs > 1 ? o.record + "." + std::to_string(line.seed) : o.record;
    recorder = std::make_unique<wb::RecordingWriter>(file, config.robot, config.disabled_terms);
    system.record_steps();
  }
  wb::RunObserver observer(system, o.object, wb::RunObserver::threshold(o.object));
  if (!o.pictures.empty())
    observer.write_to(o.runs > 1 ? o.pictures + "/" + std::to_string(line.seed) : o.pictures);

  wb::Request reset, open;
  reset.id = 1;
  reset.kind = wb::RequestKind::kReset;
  open.id = 2;
  open.kind = wb::RequestKind::kOpen;
  open.object = wb::Name(o.object);
  system.submit(reset);
  system.submit(open);

  bool ended = false, reached = false;
  wb::Phase last_phase = wb::Phase::kNone;
  wb::TimeNs next_print = 0;
  while (!ended) {
    const wb::TimeNs now = lockstep.run_next();
    if (recorder) recorder->drain(system.arrows());
    observer.sample(now);
    const wb::Phase phase = system.state().phase;
    if (phase != last_phase) {
      if (o.verbose)
        std::fprintf(stderr, "%4lu %7.3f s %s\n", line.seed, wb::to_seconds(now),
                     std::string(to_string(phase)).c_str());
      // The pre-grasp pose is reached when the sequencer goes on to the grasp.
      if (o.until == "pre-grasp" && phase == wb::Phase::kGrasp) ended = reached = true;
      last_phase = phase;
    }
    if (o.verbose && now >= next_print) {
      next_print = now + wb::kNanosPerSecond / 2;
      print_state(system, now);
    }
    wb::RequestStatus status;
    while (system.arrows().statuses.pop(status)) {
      if (status.outcome == wb::RequestOutcome::kRefused ||
          status.outcome == wb::RequestOutcome::kFailed) {
        line.failure = std::string(status.reason.view());
        ended = true;
      } else if (status.id == open.id && status.outcome == wb::RequestOutcome::kSucceeded) {
        ended = true;
      }
    }
    if (wb::to_seconds(now) > o.limit_s) {
      line.failure = "time limit of the study";
      ended = true;
    }
    line.final_time_s = wb::to_seconds(now);
  }
  observer.finish();
  line.result = observer.result();
  line.success = o.until == "pre-grasp" ? reached : line.result.opened;
  if (line.success) line.failure.clear();
  line.state_hash = system.state_hash();
  for (std::size_t i = 0; i < lockstep.loops(); ++i)
    line.cpu_us += 1e-3 * static_cast<double>(lockstep.counters(i).cpu_ns.load());
  line.mpc_p99_ms = mpc_timer.quantile_ms(0.99);
  line.mapping_p99_ms = mapping_timer.quantile_ms(0.99);
  return line;
}

std::string field(const std::string& json, const std::string& key) {
  const std::size_t at = json.find("\"" + key + "\": ");
  if (at == std::string::npos) return "";
  const std::size_t start = at + key.size() + 4;
  return json.substr(start, json.find_first_of(",}", start) - start);
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  CLI::App app{"Opens an object from random starts in lockstep; a JSON line a run, a summary last"};
  app.add_option("--robot", o.robot)->capture_default_str();
  app.add_option("--scene", o.scene)->capture_default_str();
  app.add_option("--object", o.object)->capture_default_str();
  app.add_option("--planner", o.planner)->check(CLI::IsMember({"slq-wbc"}))->capture_default_str();
  app.add_option("--runs", o.runs)->check(CLI::Range(1, 100000))->capture_default_str();
  app.add_option("--seed", o.seed, "run i has seed + i")->capture_default_str();
  app.add_option("--jobs", o.jobs, "processes")->check(CLI::Range(1, 256))->capture_default_str();
  app.add_option("--json", o.json, "write the lines to this file, too");
  app.add_option("--until", o.until)
      ->check(CLI::IsMember({"pre-grasp", "end"}))
      ->capture_default_str();
  app.add_flag("--no-environment", o.no_environment,
               "without the map, for route and MPC alike: what it is worth");
  app.add_option("--record", o.record, "record the run (with several: FILE.SEED each)");
  app.add_option("--pictures", o.pictures, "folder for run.csv and pictures");
  app.add_option("--config", o.config)->check(CLI::ExistingFile)->capture_default_str();
  app.add_flag("--verbose", o.verbose, "phases, tracking errors and term costs on stderr");
  CLI11_PARSE(app, argc, argv);

  // A process for each job; every one writes whole lines into one pipe, smaller than the pipe's
  // atomic size.
  int ends[2];
  if (pipe(ends) != 0) return 1;
  const int jobs = std::min(o.jobs, o.runs);
  for (int j = 0; j < jobs; ++j) {
    const pid_t child = fork();
    if (child < 0) return 1;
    if (child > 0) continue;
    close(ends[0]);
    int status = 0;
    for (int run = j; run < o.runs; run += jobs) {
      std::string text;
      try {
        text = run_one(o, run).json() + "\n";
      } catch (const std::exception& e) {
        std::fprintf(stderr, "run %d: %s\n", run, e.what());
        status = 1;
        break;
      }
      if (write(ends[1], text.data(), text.size()) != static_cast<ssize_t>(text.size())) status = 1;
    }
    _exit(status);
  }
  close(ends[1]);
  std::map<int, std::string> lines;
  {
    std::FILE* in = fdopen(ends[0], "r");
    char* buffer = nullptr;
    std::size_t capacity = 0;
    while (getline(&buffer, &capacity, in) > 0) {
      std::string text(buffer);
      text.pop_back();
      lines[std::stoi(field(text, "run"))] = text;
      std::fprintf(stderr, "%s\n", text.c_str());
    }
    std::free(buffer);
    std::fclose(in);
  }
  bool failed = false;
  for (int status; wait(&status) > 0;) {
    if (WIFSIGNALED(status))
      std::fprintf(stderr, "a job was ended by signal %d\n", WTERMSIG(status));
    failed = failed || status != 0;
  }

  int successes = 0, collided = 0, collided_successes = 0;
  double mpc_p99 = 0, mapping_p99 = 0, slip = 0;
  std::vector<double> times;
  std::ofstream file;
  if (!o.json.empty()) file.open(o.json);
  for (const auto& [run, text] : lines) {
    std::printf("%s\n", text.c_str());
    if (file) file << text << "\n";
    const bool success = field(text, "success") == "true",
               collision = field(text, "collisions") != "0";
    successes += success;
    collided += collision;
    collided_successes += success && collision;
    times.push_back(field(text, "time_s") == "null" ? INFINITY : std::stod(field(text, "time_s")));
    mpc_p99 = std::max(mpc_p99, std::stod(field(text, "mpc_p99_ms")));
    mapping_p99 = std::max(mapping_p99, std::stod(field(text, "mapping_p99_ms")));
    slip = std::max(slip, std::stod(field(text, "slip_m")));
  }
  if (static_cast<int>(lines.size()) != o.runs) failed = true;
  std::sort(times.begin(), times.end());
  const wb::DaemonConfig config = make_config(o, o.seed);
  const double mpc_declared = 1e-6 * static_cast<double>(config.mpc.latency_ns),
               mapping_declared = 1e-6 * static_cast<double>(config.mapping.latency_ns);
  const bool latencies_hold = mpc_p99 <= mpc_declared && mapping_p99 <= mapping_declared;
  std::ostringstream summary;
  summary << "{\"summary\": true, \"robot\": \"" << o.robot << "\", \"scene\": \"" << o.scene
          << "\", \"object\": \"" << o.object << "\", \"planner\": \"" << o.planner
          << "\", \"seed\": " << o.seed << ", \"runs\": " << lines.size()
          << ", \"successes\": " << successes << ", \"median_time_s\": ";
  const double median =
      times.empty() ? INFINITY : 0.5 * (times[(times.size() - 1) / 2] + times[times.size() / 2]);
  if (std::isfinite(median)) {
    summary << median;
  } else {
    summary << "null";
  }
  summary << ", \"collided_runs\": " << collided
          << ", \"collided_successes\": " << collided_successes << ", \"max_slip_m\": " << slip
          << ", \"mpc_p99_ms\": " << mpc_p99 << ", \"mpc_declared_ms\": " << mpc_declared
          << ", \"mapping_p99_ms\": " << mapping_p99
          << ", \"mapping_declared_ms\": " << mapping_declared
          << ", \"latencies_hold\": " << (latencies_hold ? "true" : "false") << ", \"noise\": "
          << wb::bench::scene_noise_json(std::filesystem::path(o.config).parent_path() / "scenes" /
                                         (o.scene + ".yaml"))
          << "}";
  std::printf("%s\n", summary.str().c_str());
  if (file) file << summary.str() << "\n";
  if (!latencies_hold)
    std::fprintf(stderr,
                 "the declared latencies are below the measured p99: the study does not count\n");
  return failed || !latencies_hold ? 1 : 0;
}
