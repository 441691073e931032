// One simulated run in lockstep, wired as wholebodyd does it, with the simulator's truth and faults
// at hand and loops that can be made to hang. The test's thread is every loop's. Frames: S
// simulated world, W odometry. SI.
#pragma once
#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/rt/executor.hpp"
#include "daemon/recording.hpp"
#include "daemon/system.hpp"

namespace wb::test {

struct RunOptions {
  std::uint64_t seed = 1;
  std::string robot = "mabi_mobile";
  std::string spawn = "random";                    // or {x_m, y_m, yaw_rad}
  std::string scene = "scenes/kitchen_line.yaml";  // in config/, or absolute
  std::vector<std::string> disabled_terms = {};
  bool blind = false;  // the MPC loop gets no map
};

inline DaemonConfig run_config(const RunOptions& o) {
  DaemonConfig c =
      DaemonConfig::load(WB_SOURCE_DIR "/config/wholebodyd.yaml", WB_BUILD_DIR "/drivers");
  c.seed = o.seed;
  c.robot = WB_SOURCE_DIR "/config/robots/" + o.robot;
  c.drivers.at(0).config = "{robot: robots/" + o.robot + ", scene: " + o.scene +
                           ", seed: " + std::to_string(o.seed) + ", spawn: " + o.spawn + "}";
  c.disabled_terms = o.disabled_terms;
  c.blind = o.blind;
  return c;
}

// Mabi-Mobile's true posture: the base, and every arm link in its parent.
struct Posture {
  Eigen::Isometry3d X_SB;
  std::vector<Eigen::Matrix3d> R_parent_link;
};

inline double turn(const Eigen::Matrix3d& R) { return std::abs(Eigen::AngleAxisd(R).angle()); }
inline double yaw(const Eigen::Isometry3d& X) { return std::atan2(X(1, 0), X(0, 0)); }

// Largest displacement of the base [m], its turn and any joint's [rad].
struct Displacement {
  double base_m, base_rad, joint_rad;
};

inline Displacement between(const Posture& a, const Posture& b) {
  Displacement d{(b.X_SB.translation() - a.X_SB.translation()).norm(),
                 turn(a.X_SB.linear().transpose() * b.X_SB.linear()), 0};
  for (std::size_t i = 0; i < a.R_parent_link.size(); ++i) {
    d.joint_rad = std::max(d.joint_rad, turn(a.R_parent_link[i].transpose() * b.R_parent_link[i]));
  }
  return d;
}

class SimulatedRun {
 public:
  // A daemon's configuration as it stands.
  struct Configured {
    DaemonConfig config;
  };
  explicit SimulatedRun(const RunOptions& options = {})
      : SimulatedRun(Configured{run_config(options)}) {}
  explicit SimulatedRun(const Configured& configured)
      : config_(configured.config),
        system_(config_,
                [](wb_log_level level, const std::string& text) {
                  if (level >= WB_LOG_WARN) std::fprintf(stderr, "%s\n", text.c_str());
                }),
        lockstep_([this](TimeNs t) { system_.advance(t); }) {
    for (Loop& loop : system_.loops()) {
      bool& hung = hung_[loop.name];
      loop.step = [&hung, step = std::move(loop.step)](TimeNs t) {
        if (!hung) step(t);
      };
      if (loop.deliver) {
        loop.deliver = [&hung, deliver = std::move(loop.deliver)] {
          if (!hung) deliver();
        };
      }
      lockstep_.add(std::move(loop));
    }
    truth_ = static_cast<const wb_sim_truth*>(system_.host().extension(WB_SIM_TRUTH, &driver_));
    fault_ = static_cast<const wb_sim_fault*>(system_.host().extension(WB_SIM_FAULT, &driver_));
  }

  System& system() { return system_; }
  const wb_sim_truth& truth() const { return *truth_; }
  const wb_sim_fault& fault() const { return *fault_; }
  wb_driver* driver() const { return driver_; }
  TimeNs now() const { return lockstep_.now(); }
  Mode mode() const { return system_.state().mode; }
  Phase phase() const { return system_.state().phase; }

  // Writes what every step is handed to `file`; call before anything runs.
  void record(const std::filesystem::path& file) {
    recorder_ = std::make_unique<RecordingWriter>(file, config_.robot, config_.disabled_terms);
    system_.record_steps();
  }

  void stop_recording() { recorder_.reset(); }  // closes the file

  // The loop's thread does nothing any more, or goes on.
  void hang(const std::string& loop, bool on = true) { hung_.at(loop) = on; }

  // Runs the next instant with an event.
  void step() {
    lockstep_.run_next();
    if (recorder_) recorder_->drain(system_.arrows());
    RequestStatus status;
    while (system_.arrows().statuses.pop(status) || system_.arrows().mpc_statuses.pop(status))
      statuses_[status.id] = status;
  }
  void run_for(double seconds) {
    for (const TimeNs end = now() + from_seconds(seconds); now() < end;) step();
  }
  // False: not within limit_s.
  template <class Condition>
  [[nodiscard]] bool run_until(Condition&& condition, double limit_s) {
    for (const TimeNs end = now() + from_seconds(limit_s); now() < end;) {
      if (condition()) return true;
      step();
    }
    return condition();
  }

  // The requests' ids.
  std::uint64_t reset() { return submit(request(RequestKind::kReset)); }
  std::uint64_t open(const std::string& object) {
    Request r = request(RequestKind::kOpen);
    r.object = Name(object);
    return submit(r);
  }
  std::uint64_t tune(const std::string& weight, double value) {
    Request r = request(RequestKind::kTune);
    r.weight = system_.problem().weights().find(weight);
    r.value = value;
    return submit(r);
  }
  std::uint64_t revert(const std::string& weight = "") {
    Request r = request(RequestKind::kRevert);
    r.weight = weight.empty() ? -1 : system_.problem().weights().find(weight);
    return submit(r);
  }
  std::uint64_t move_base(const std::array<double, 3>& goal) {
    Request r = request(RequestKind::kMoveBase);
    r.base = goal;
    return submit(r);
  }
  std::uint64_t move_joints(const std::vector<double>& q) {
    Request r = request(RequestKind::kMoveJoints);
    r.joint_count = static_cast<int>(q.size());
    std::copy(q.begin(), q.end(), r.q.begin());
    return submit(r);
  }
  // Newest status of a request.
  RequestStatus status(std::uint64_t id) const {
    const auto at = statuses_.find(id);
    return at == statuses_.end() ? RequestStatus{} : at->second;
  }
  RequestOutcome outcome(std::uint64_t id) const { return status(id).outcome; }
  // The request has an outcome that is its last.
  bool ended(std::uint64_t id) const {
    return statuses_.contains(id) && outcome(id) != RequestOutcome::kAccepted &&
           outcome(id) != RequestOutcome::kRunning;
  }
  [[nodiscard]] bool run_to_end(std::uint64_t id, double limit_s) {
    return run_until([&] { return ended(id); }, limit_s) &&
           outcome(id) == RequestOutcome::kSucceeded;
  }

  Posture posture() const {
    Posture out;
    Eigen::Isometry3d X_SP = out.X_SB = isometry(truth_->base_pose(driver_));
    for (const char* link : {"SHOULDER", "ARM", "ELBOW", "FOREARM", "WRIST_1", "WRIST_2"}) {
      const Eigen::Isometry3d X_SL = link_pose(link);
      out.R_parent_link.push_back(X_SP.linear().transpose() * X_SL.linear());
      X_SP = X_SL;
    }
    return out;
  }
  Eigen::Isometry3d link_pose(const char* link) const {
    wb_sim_pose X_SL;
    EXPECT_EQ(truth_->link_pose(driver_, link, &X_SL), WB_OK);
    return isometry(X_SL);
  }
  // The base where it truly is, in W.
  Eigen::Isometry3d base() const {
    return isometry(truth_->spawn_pose(driver_)).inverse() * isometry(truth_->base_pose(driver_));
  }
  std::uint32_t object_index(const std::string& name) const {
    wb_sim_object o;
    for (std::uint32_t i = 0; i < truth_->object_count(driver_); ++i) {
      if (truth_->object(driver_, i, &o) == WB_OK && name == o.name) return i;
    }
    throw std::runtime_error("no object " + name);
  }
  wb_sim_object object(const std::string& name) const {
    wb_sim_object o;
    EXPECT_EQ(truth_->object(driver_, object_index(name), &o), WB_OK);
    return o;
  }
  // Distance of the arm's collision spheres (which cover its solids within 25 mm) from the box
  // about an object's moving part; negative inside.
  double arm_clearance(const std::string& name) const {
    const wb_sim_object o = object(name);
    const Eigen::Isometry3d X_MS = isometry(o.moving.X_SM).inverse();
    const Eigen::Map<const Eigen::Array3d> half(o.moving.half_extent);
    double least = 1e9;
    for (const SphereConfig& s : system_.model().config().spheres) {
      if (s.link == system_.model().config().base.link) continue;
      const Eigen::Vector3d p_M = X_MS * (link_pose(s.link.c_str()) * s.centre);
      const Eigen::Array3d beyond = p_M.array().abs() - half;
      const double distance =
          beyond.maxCoeff() < 0 ? beyond.maxCoeff() : beyond.max(0.0).matrix().norm();
      least = std::min(least, distance - s.radius);
    }
    return least;
  }
  std::uint32_t contacts() const { return truth_->contact_count(driver_); }
  // What touched what, for messages.
  std::string contact_names() const {
    std::string names;
    wb_sim_contact c;
    for (std::uint32_t i = 0; i < contacts(); ++i) {
      if (truth_->contact(driver_, i, &c) == WB_OK)
        names += std::string(c.robot_geom) + " on " + c.other_geom + "; ";
    }
    return names;
  }

 private:
  static Request request(RequestKind kind) {
    Request r;
    r.kind = kind;
    return r;
  }
  std::uint64_t submit(Request request) {
    request.id = ++last_id_;
    EXPECT_TRUE(system_.submit(request));
    return request.id;
  }

  DaemonConfig config_;
  System system_;
  Lockstep lockstep_;
  std::map<std::string, bool> hung_;
  wb_driver* driver_ = nullptr;
  const wb_sim_truth* truth_ = nullptr;
  const wb_sim_fault* fault_ = nullptr;
  std::unique_ptr<RecordingWriter> recorder_;
  std::uint64_t last_id_ = 0;
  std::map<std::uint64_t, RequestStatus> statuses_;
};

}  // namespace wb::test
