#include "daemon/robot/simulated_move.hpp"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

#include "core/rt/executor.hpp"
#include "daemon/plugin_folder.hpp"
#include "daemon/system.hpp"
#include "drivers/sim/truth.h"

namespace wb {
namespace {

namespace fs = std::filesystem;

constexpr char kName[] = "simulation";
constexpr double kJointError = 0.02;  // rad or m
constexpr double kStay_s = 1;         // that the robot must stay there before it is measured

// Nothing but floor; noise of config/scenes/kitchen_line.yaml.
constexpr char kEmptyFloor[] = R"(
name: empty_floor
floor: {x_m: [-5, 5], y_m: [-5, 5]}
colours: {floor: [0.55, 0.53, 0.50]}
items: []
noise: {depth_m_per_m2: 0.0015, depth_dropout_fraction: 0.01, camera_delay_s: 0.030, encoder_rad: 1.0e-4,
  encoder_radps: 1.0e-3, effort_nm: 0.1, gyro_radps: 2.0e-3, gyro_walk_radps_per_sqrt_s: 1.0e-4,
  accelerometer_mps2: 0.02, wrench_n: 0.1, wrench_nm: 0.01, gripper_m: 1.0e-4, gripper_n: 0.5}
view: {position_m: [-2, -2, 2], target_m: [0, 0, 0.5], width_rad: 1.2}
light_m: [0, 0, 3]
)";

class SceneFile {
 public:
  SceneFile()
      : path_(fs::temp_directory_path() /
              ("wb_empty_floor_" + std::to_string(getpid()) + ".yaml")) {
    std::ofstream(path_) << kEmptyFloor;
  }
  ~SceneFile() {
    std::error_code none;
    fs::remove(path_, none);
  }
  SceneFile(const SceneFile&) = delete;
  SceneFile& operator=(const SceneFile&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

// The loops of config/wholebodyd.yaml.
DaemonConfig daemon_config(const fs::path& folder, const fs::path& scene, unsigned seed) {
  constexpr TimeNs kMs = 1'000'000;
  DaemonConfig c;
  c.robot = folder;
  c.interpreter = "none";
  c.seed = seed;
  c.control = {400, 0, 0};
  c.mpc = {30, 10 * kMs, 0};
  c.frames = {60, 0, 0};
  c.mapping = {15, 40 * kMs, 0};
  c.perception = {10, 50 * kMs, 0};
  c.command_timeout_ns = 50 * kMs;
  PluginSpec sim;
  sim.library = default_plugin_folder() / "libwb_driver_sim.so";
  sim.folder = folder;
  sim.config = "{robot: \"" + folder.string() + "\", scene: \"" + scene.string() +
               "\", seed: " + std::to_string(seed) + ", spawn: {x_m: 0, y_m: 0, yaw_rad: 0}}";
  c.drivers.push_back(sim);
  return c;
}

double off(const RobotModel& model, int joint, double q, double goal) {
  const double off = q - goal;
  return std::abs(model.limits(joint).endless() ? std::remainder(off, 2 * std::numbers::pi) : off);
}

class Move {
 public:
  Move(const DaemonConfig& config, const DriverHost::Log& log)
      : system_(config, log), lockstep_([this](TimeNs t) { system_.advance(t); }) {
    for (Loop& loop : system_.loops()) lockstep_.add(std::move(loop));
    truth_ = static_cast<const wb_sim_truth*>(system_.host().extension(WB_SIM_TRUTH, &driver_));
  }

  CheckLine run() {
    const RobotModel& model = system_.model();
    const std::vector<double>&from = model.config().stowed, &to = model.config().ready;
    double slowest_s = 0;
    for (int j = 0; j < model.joints(); ++j) {
      const auto i = static_cast<std::size_t>(j);
      slowest_s = std::max(slowest_s, off(model, j, from[i], to[i]) / model.limits(j).velocity);
    }
    submit_reset();
    submit_move(to);
    const double limit_s = 2 * slowest_s + 10;
    while (!ended() && lockstep_.now() < from_seconds(limit_s)) step();
    const double took_s = to_seconds(lockstep_.now());
    for (const TimeNs end = lockstep_.now() + from_seconds(kStay_s); lockstep_.now() < end;) step();

    double worst = 0;
    std::string which;
    for (int j = 0; j < model.joints(); ++j) {
      const auto i = static_cast<std::size_t>(j);
      const double error = off(model, j, system_.state().q[j], to[i]);
      if (j > 0 && error < worst) continue;
      worst = error;
      which = model.config().joints[i].name;
    }
    std::ostringstream text;
    text.precision(3);
    text << "largest joint error (" << which << ") after the move from stowed to ready, ";
    if (status_.outcome == RequestOutcome::kSucceeded) {
      text << "done in " << took_s << " s";
    } else if (ended()) {
      text << "which failed: " << status_.reason.view();
    } else {
      text << "not done within " << limit_s << " s";
    }
    text << "; at most 0.02; contacts: " << contacts();
    const bool ok = status_.outcome == RequestOutcome::kSucceeded && worst <= kJointError &&
                    truth_->contact_count(driver_) == 0;
    return {kName, ok, worst, "rad", text.str()};
  }

 private:
  void submit_reset() {
    Request r;
    r.kind = RequestKind::kReset;
    r.id = 1;
    system_.submit(r);
  }
  void submit_move(const std::vector<double>& q) {
    Request r;
    r.kind = RequestKind::kMoveJoints;
    r.id = status_.id = 2;
    r.joint_count = static_cast<int>(q.size());
    std::copy(q.begin(), q.end(), r.q.begin());
    system_.submit(r);
    status_.outcome = RequestOutcome::kAccepted;
  }
  bool ended() const {
    return status_.outcome != RequestOutcome::kAccepted &&
           status_.outcome != RequestOutcome::kRunning;
  }
  void step() {
    lockstep_.run_next();
    for (RequestStatus s; system_.arrows().statuses.pop(s);) {
      if (s.id == status_.id) status_ = s;
    }
  }
  std::string contacts() const {
    const std::uint32_t count = truth_->contact_count(driver_);
    std::string out = std::to_string(count);
    wb_sim_contact c;
    for (std::uint32_t i = 0; i < std::min(count, 3u); ++i) {
      if (truth_->contact(driver_, i, &c) != WB_OK) continue;
      out += std::string(i == 0 ? " (" : ", ") + c.robot_geom + " on " + c.other_geom;
    }
    return out + (count > 3 ? ", ...)" : count > 0 ? ")" : "");
  }

  System system_;
  Lockstep lockstep_;
  wb_driver* driver_ = nullptr;
  const wb_sim_truth* truth_ = nullptr;
  RequestStatus status_;  // of the move
};

}  // namespace

CheckLine check_simulated_move(const fs::path& folder, unsigned seed) {
  std::string errors;  // of the driver, which throws without them
  const auto log = [&errors](wb_log_level level, const std::string& text) {
    if (level >= WB_LOG_ERROR) errors += ": " + text;
  };
  try {
    const SceneFile scene;
    return Move(daemon_config(fs::absolute(folder), scene.path(), seed), log).run();
  } catch (const std::exception& error) {
    return {kName, false, 0, "", error.what() + errors};
  }
}

}  // namespace wb
