// What the three steps cost: MotionPlanner::step, Mapper::update with four frames,
// Controller::step, each on what a lockstep run handed it while it pulled a drawer open with an
// obstacle close behind. Thread CPU time, made equivalent by the sweep (DEFINITIONS.md, "Equivalent
// time"). Deterministic but for the times. Exit code 1 if a bound is broken.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <deque>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <sstream>

#include "bench/equivalent_time.hpp"
#include "bench/figures.hpp"
#include "bench/scene_noise.hpp"
#include "core/rt/allocation_count.hpp"
#include "core/rt/executor.hpp"
#include "daemon/system.hpp"

namespace {

using wb::TimeNs;
using wb::bench::Figure;

struct Options {
  std::string config = WB_SOURCE_DIR "/config/wholebodyd.yaml";
  std::string json;
  std::uint64_t seed = 1;
  std::size_t calls = 1000;
};

constexpr std::size_t kFrames = 4;                   // in each update of the map
constexpr int kSpheresLeast = 20, kActiveLeast = 3;  // fewer: the MPC's step would be too cheap
// 2 s before the pull: they bring the warm start to where it was in the run.
constexpr std::size_t kMpcBefore = 60, kMappingBefore = 30;
// Relative, of the MPC's cost against the run's: converged from cold it differs by some 1e-13.
constexpr double kCostTolerance = 1e-6;
constexpr std::ptrdiff_t kMpcLeast = 30;  // a second of such steps
constexpr double kRunLimit_s = 60;
constexpr int kSeedsMost = 8;  // tried until a run serves
constexpr const char *kScene = "kitchen_line", *kObject = "drawer_1";
// Added to the scene: a box behind the place from where the robot pulls. The base backs off as it
// pulls, its tower comes near the box, and the environment's hinges become active.
constexpr const char* kBox =
    "  - {type: box, name: box_behind, x_y_yaw: [-0.99, 1.16, 0], size_m: [0.3, 1.0, 0.9], "
    "bottom_m: 0, colour: wall}";

// What each step was handed. Pointers are into Capture's deques.
struct ControlCall {
  wb::ControlRecord record;
  const wb::Policy* policy = nullptr;
  const wb::ObjectPlan* plan = nullptr;

  wb::ControlInput input() const {
    return {record.t_ns, &record.readings,       policy,
            plan,        record.requests.data(), record.request_count};
  }
};
struct MpcCall {
  wb::RobotState state;
  wb::Reference reference;
  const wb::DistanceField* field;
  double cost_after;  // these two: of its result, in the run
  int active_spheres;
};
struct MappingCall {
  std::vector<wb::RobotState> states;
  std::vector<wb::DepthFrame> frames;

  void hand_to(wb::Mapper& mapper, wb::DistanceField& field) const {
    const wb::DepthFrame* views[wb::MappingRecord::kMaxFrames];
    for (std::size_t i = 0; i < frames.size(); ++i) views[i] = &frames[i];
    for (const wb::RobotState& s : states) mapper.push_state(s);
    mapper.update({views, frames.size()}, field);
  }
  void shift(TimeNs by) {
    for (wb::RobotState& s : states) s.t_ns += by;
    for (wb::DepthFrame& f : frames) f.t_ns += by;
  }
};
struct Capture {
  std::shared_ptr<const wb::RobotModel> model;
  std::vector<std::string> disabled_terms;
  std::deque<wb::Policy> policies;
  std::deque<wb::ObjectPlan> plans;
  std::deque<wb::DistanceField> fields;
  std::deque<ControlCall> control;  // of the pull
  std::deque<MpcCall> mpc;          // these two: what came before, then the pull
  std::deque<MappingCall> mapping;
  std::size_t first_mpc = 0, first_mapping = 0;  // of the pull
  std::unique_ptr<wb::Controller> controller;    // as it stood when the pull began
  std::unique_ptr<wb::Mapper> mapper;            // as it stood before the first of `mapping`
};

// The run of this seed is no use, another one's may be.
struct Unsuitable : std::runtime_error {
  using std::runtime_error::runtime_error;
};

std::filesystem::path scene_file(const Options& o) {
  return std::filesystem::path(o.config).parent_path() / "scenes" / (std::string(kScene) + ".yaml");
}

// The scene with the box, in a file of its own that goes with this object.
class SceneWithBox {
 public:
  explicit SceneWithBox(const std::filesystem::path& scene) {
    std::ifstream in(scene);
    std::ofstream out(file_);
    bool entered = false;
    for (std::string line; std::getline(in, line);) {
      out << line << "\n";
      if (line != "items:") continue;
      out << kBox << "\n";
      entered = true;
    }
    out.close();
    if (!entered || !out) throw std::runtime_error("no box could be put into " + scene.string());
  }
  ~SceneWithBox() { std::filesystem::remove(file_); }
  SceneWithBox(const SceneWithBox&) = delete;
  SceneWithBox& operator=(const SceneWithBox&) = delete;
  const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_ = std::filesystem::temp_directory_path() /
                                ("loops_scene_" + std::to_string(getpid()) + ".yaml");
};

wb::DaemonConfig make_config(const Options& o, const std::filesystem::path& scene) {
  wb::DaemonConfig c = wb::DaemonConfig::load(o.config, WB_PLUGIN_DIR);
  c.seed = o.seed;
  std::ostringstream plugin;
  plugin << "{robot: " << std::filesystem::absolute(c.robot).string()
         << ", scene: " << scene.string() << ", seed: " << o.seed << ", spawn: random}";
  c.drivers.at(0).config = plugin.str();
  return c;
}

// Stores the newest of a sequence of buffered values, once each.
template <class T>
const T* keep(const T* value, std::deque<T>& kept) {
  if (!value) return nullptr;
  if (kept.empty() || kept.back().seq != value->seq) kept.push_back(*value);
  return &kept.back();
}

// Runs the robot until the object is open. A second controller and a second mapper beside the
// system's are handed the same, and so come to the same state. Throws Unsuitable if the run fails
// or its pull does not serve.
Capture capture(const Options& o) {
  const SceneWithBox scene(scene_file(o));
  const wb::DaemonConfig config = make_config(o, scene.file());
  wb::System system(config, [](wb_log_level level, const std::string& text) {
    if (level >= WB_LOG_WARN) std::fprintf(stderr, "%s\n", text.c_str());
  });
  system.record_steps();
  wb::Arrows& arrows = system.arrows();
  Capture out;
  out.model = system.shared_model();
  out.disabled_terms = config.disabled_terms;
  out.mapper = std::make_unique<wb::Mapper>(out.model);
  wb::Controller controller(out.model);
  wb::DistanceField field = out.mapper->make_field();
  wb::StateHash hash;
  wb::ObjectPlan plan;
  bool pulling = false, pulled = false, succeeded = false;

  const auto after_control = [&] {
    ControlCall call;
    if (!arrows.control_records.pop(call.record))
      throw std::runtime_error("a control step left no record");
    while (arrows.plan_records.pop(plan)) {
    }
    // The service's side of the arrow: nobody else reads it here.
    call.policy = call.record.policy_seq ? arrows.policy.read(1) : nullptr;
    call.plan = call.record.plan_seq ? &plan : nullptr;
    wb::RobotState state;
    wb::Reference reference;
    wb::ControlOutput output;
    output.state = &state;
    output.reference = &reference;
    controller.step(call.input(), output);
    hash.add(state);
    hash.add(output.command);
    if (hash.value() != call.record.state_hash)
      throw std::runtime_error("the second controller has left the run");
    if (pulling) {
      call.policy = keep(call.policy, out.policies);
      call.plan = keep(call.plan, out.plans);
      out.control.push_back(call);
    }
    const bool held = state.phase == wb::Phase::kManipulate;
    if (held && !pulling && !pulled) {
      out.controller = std::make_unique<wb::Controller>(controller);
      out.first_mpc = out.mpc.size();
      out.first_mapping = out.mapping.size();
    }
    pulled = pulled || (pulling && !held);
    pulling = held && !pulled;
  };
  const auto after_mpc = [&] {
    if (pulled || system.state().mode != wb::Mode::kActive) return;
    // Nothing is published between the step and here: the field's reader still holds what the step
    // was handed.
    const wb::SolveReport& report = system.solve_report();
    out.mpc.push_back({system.state(), system.reference(), keep(arrows.field.read(), out.fields),
                       report.cost_after, report.active_environment_spheres});
    if (pulling || out.mpc.size() <= kMpcBefore) return;
    out.mpc.pop_front();
    while (!out.fields.empty() && out.mpc.front().field &&
           &out.fields.front() != out.mpc.front().field)
      out.fields.pop_front();
  };
  const auto before_mapping = [&] {
    if (pulled) return;
    MappingCall& call = out.mapping.emplace_back();
    for (std::size_t i = 0; const wb::RobotState* s = arrows.states_to_mapping.peek(i); ++i)
      call.states.push_back(*s);
    for (std::size_t i = 0; const wb::DepthFrame* f = arrows.frames.peek(i); ++i)
      call.frames.push_back(*f);
    if (pulling || out.mapping.size() <= kMappingBefore) return;
    out.mapping.front().hand_to(*out.mapper, field);
    out.mapping.pop_front();
  };

  wb::Lockstep lockstep([&](TimeNs t) { system.advance(t); });
  for (wb::Loop& loop : system.loops()) {
    loop.step = [&, name = loop.name, step = std::move(loop.step)](TimeNs t) {
      if (name == "mapping") before_mapping();
      step(t);
      if (name == "control") after_control();
      if (name == "mpc") after_mpc();
    };
    lockstep.add(std::move(loop));
  }
  wb::Request request;
  request.id = 1;
  request.kind = wb::RequestKind::kReset;
  system.submit(request);
  request.id = 2;
  request.kind = wb::RequestKind::kOpen;
  request.object = wb::Name(kObject);
  system.submit(request);
  while (!succeeded) {
    const TimeNs now = lockstep.run_next();
    for (wb::RequestStatus status; arrows.statuses.pop(status);) {
      succeeded = succeeded ||
                  (status.id == request.id && status.outcome == wb::RequestOutcome::kSucceeded);
      if (status.outcome != wb::RequestOutcome::kRefused &&
          status.outcome != wb::RequestOutcome::kFailed)
        continue;
      throw Unsuitable("the run failed: " + std::string(status.reason.view()));
    }
    if (wb::to_seconds(now) > kRunLimit_s) throw Unsuitable("the run did not come to its end");
  }
  for (std::size_t i = out.first_mapping; i < out.mapping.size(); ++i) {
    if (out.mapping[i].frames.size() != kFrames)
      throw std::runtime_error("an update of the map was not handed four frames");
  }
  const auto counted =
      std::count_if(out.mpc.begin() + static_cast<std::ptrdiff_t>(out.first_mpc), out.mpc.end(),
                    [](const MpcCall& c) { return c.active_spheres >= kActiveLeast; });
  if (counted < kMpcLeast)
    throw Unsuitable("in " + std::to_string(counted) +
                     " of the pull's MPC steps enough hinges were active");
  return out;
}

// The first seed from --seed on whose run opens the object with the hinges active.
Capture capture_any(Options& o) {
  for (int tried = 1;; ++tried, ++o.seed) {
    try {
      return capture(o);
    } catch (const Unsuitable& e) {
      std::fprintf(stderr, "seed %lu does not serve: %s\n", o.seed, e.what());
      if (tried == kSeedsMost) throw;
    }
  }
}

struct Measured {
  wb::bench::EquivalentTimer timer;
  std::uint64_t allocations = 0;

  template <class F>
  void time(F&& f) {
    timer.time([&] {
      const std::uint64_t before = wb::thread_allocations();
      f();
      allocations += wb::thread_allocations() - before;
    });
  }
};

// Every pass is the pull once more, from the state that the controller had.
void measure_control(const Capture& in, std::size_t calls, Measured& m) {
  wb::RobotState state;
  wb::Reference reference;
  while (m.timer.steps() < calls) {
    wb::Controller controller = *in.controller;
    for (const ControlCall& call : in.control) {
      wb::ControlOutput output;
      output.state = &state;
      output.reference = &reference;
      m.time([&] { controller.step(call.input(), output); });
    }
  }
}

// Every pass starts cold, 2 s before the pull, and must come to the run's costs. Measures the steps
// with enough hinges active; returns the least number of them.
int measure_mpc(const Capture& in, std::size_t calls, Measured& m) {
  wb::MotionPlanner planner(in.model, in.disabled_terms);
  const auto policy = std::make_unique<wb::Policy>();
  wb::SolveReport report;
  int least_active = std::numeric_limits<int>::max();
  while (m.timer.steps() < calls) {
    planner.reset();
    for (std::size_t i = 0; i < in.mpc.size(); ++i) {
      const MpcCall& call = in.mpc[i];
      const auto step = [&] {
        (void)planner.step(call.state, call.reference, call.field, *policy, report);
      };
      if (i < in.first_mpc || call.active_spheres < kActiveLeast) {
        step();
        continue;
      }
      m.time(step);
      least_active = std::min(least_active, report.active_environment_spheres);
      if (std::abs(report.cost_after - call.cost_after) > kCostTolerance * call.cost_after) {
        throw std::runtime_error("the measured MPC steps are not those of the run");
      }
    }
  }
  return least_active;
}

// Every pass goes on with the map of the pass before; time moves on, and the robot and its drawer
// are back at the start.
void measure_mapping(Capture& in, std::size_t calls, Measured& m) {
  wb::DistanceField field = in.mapper->make_field();
  const TimeNs pass_ns = in.mapping.back().states.back().t_ns -
                         in.mapping.front().states.front().t_ns + wb::from_seconds(0.0025);
  while (m.timer.steps() < calls) {
    for (std::size_t i = 0; i < in.mapping.size(); ++i) {
      const auto step = [&] { in.mapping[i].hand_to(*in.mapper, field); };
      if (i < in.first_mapping) {
        step();
      } else {
        m.time(step);
      }
      in.mapping[i].shift(pass_ns);
    }
  }
}

std::vector<Figure> measure(Options& o) {
  Capture in = capture_any(o);
  Measured control, mpc, mapping;
  measure_control(in, o.calls, control);
  const int active = measure_mpc(in, o.calls, mpc);
  measure_mapping(in, o.calls, mapping);
  std::fprintf(stderr,
               "%s, seed %lu: the pull has %zu control, %zu MPC and %zu mapping steps; measured "
               "%zu, %zu and %zu\n",
               kObject, o.seed, in.control.size(), in.mpc.size() - in.first_mpc,
               in.mapping.size() - in.first_mapping, control.timer.steps(), mpc.timer.steps(),
               mapping.timer.steps());
  for (const auto& [name, m] :
       {std::pair{"control", &control}, {"MPC", &mpc}, {"mapping", &mapping}}) {
    std::fprintf(stderr, "sweep beside %s: median %.3f ms, p99 %.3f ms\n", name,
                 m->timer.sweep_median_ms(), m->timer.sweep_quantile_ms(0.99));
  }
  std::fprintf(stderr, "sensor noise of %s: %s\n", kScene,
               wb::bench::scene_noise_json(scene_file(o)).c_str());
  const wb::DaemonConfig config = wb::DaemonConfig::load(o.config, WB_PLUGIN_DIR);
  const auto declared_ms = [](const wb::LoopConfig& loop) {
    return 1e-6 * static_cast<double>(loop.latency_ns);
  };
  // Where nothing counts them, the figure is no number and its bound is broken.
  const double allocations =
      wb::allocations_are_counted()
          ? static_cast<double>(control.allocations + mpc.allocations + mapping.allocations)
          : std::nan("");
  return {
      {"mpc_iteration_ms", mpc.timer.quantile_ms(0.5), "ms", 3.0},
      {"mpc_iteration_p99_ms", mpc.timer.quantile_ms(0.99), "ms", declared_ms(config.mpc)},
      {"map_update_ms", mapping.timer.quantile_ms(0.5), "ms", 25.0},
      {"map_update_p99_ms", mapping.timer.quantile_ms(0.99), "ms", declared_ms(config.mapping)},
      {"control_step_us", 1e3 * control.timer.quantile_ms(0.5), "us", 150.0},
      {"control_step_p99_us", 1e3 * control.timer.quantile_ms(0.99), "us", {}},
      {"allocations", allocations, "1", 0.0},
      {"environment_spheres", static_cast<double>(in.model->spheres().size()), "1", kSpheresLeast,
       wb::bench::Better::kHigher},
      {"environment_spheres_active", static_cast<double>(active), "1", kActiveLeast,
       wb::bench::Better::kHigher},
  };
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  CLI::App app{"Cost of the control, MPC and mapping steps on inputs of a drawer's pull"};
  app.add_option("--json", o.json, "write the figures to this file");
  app.add_option(
         "--seed", o.seed,
         "of the run that hands over the inputs; the next ones are tried if it does not serve")
      ->capture_default_str();
  app.add_option("--calls", o.calls, "measured calls of each step, at least")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--config", o.config)->check(CLI::ExistingFile)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    const std::vector<Figure> figures = measure(o);
    wb::bench::print_table(figures);
    if (!o.json.empty()) wb::bench::write_json(figures, o.json);
    return wb::bench::all_hold(figures) ? 0 : 1;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "loops: %s\n", e.what());
    return 1;
  }
}
