// The wiring: builds every room from the configuration, owns the arrows between them, and gives
// each loop its step. The same loops run on Lockstep (virtual clock) or RealTime (threads). Setup
// world to build.
#pragma once
#include <memory>
#include <vector>

#include "control/controller.hpp"
#include "core/rt/loop.hpp"
#include "core/types/hash.hpp"
#include "daemon/arrows.hpp"
#include "daemon/daemon_config.hpp"
#include "daemon/truth_tap.hpp"
#include "drivers/driver_host.hpp"
#include "mapping/mapper.hpp"
#include "perception/perceiver.hpp"
#include "planning/motion_planner.hpp"

namespace wb {

class System {
 public:
  // Throws config::ConfigError or std::runtime_error.
  System(const DaemonConfig& config, DriverHost::Log log);

  // control, mpc, frames, mapping, perception: the order in Lockstep at equal times.
  std::vector<Loop> loops();
  // Steppable drivers, and the look at the simulator's truth: called by Lockstep, or, in real time,
  // by the control loop before it reads.
  void advance(TimeNs t);
  void advance_in_control() { advance_in_control_ = true; }

  // Hands a checked request to whom it concerns: the MPC loop, or control (and perception); one
  // thread. False: the queue is full.
  bool submit(Request request);
  // Must be called before the loops run, when somebody drains the record queues; otherwise steps
  // are not recorded.
  void record_steps() { recording_ = true; }

  std::set<std::string> object_names() const;  // what `open` may name
  TruthTap* truth() { return truth_.get(); }   // null without the oracle

  Arrows& arrows() { return arrows_; }
  DriverHost& host() { return host_; }
  const RobotModel& model() const { return *model_; }
  std::shared_ptr<const RobotModel> shared_model() const { return model_; }
  const DaemonConfig& config() const { return config_; }
  std::uint64_t state_hash() const { return hash_.value(); }
  // Of the newest steps; read between them only (Lockstep, benches).
  const RobotState& state() const { return state_; }
  const Reference& reference() const { return reference_; }
  const OptimalControlProblem& problem() const { return planner_.problem(); }
  const MpcRecord& mpc_record() const { return mpc_record_; }
  const SolveReport& solve_report() const { return mpc_record_.report; }
  const ControlCounters& control_counters() const { return controller_.counters(); }
  struct Opening {
    Name object;
    RequestStatus status;  // id 0: there was none
  };
  const Opening& opening() const { return opening_; }  // the `open` that was accepted last

 private:
  void control_step(TimeNs now);
  void mpc_step(TimeNs now);
  void take_tuning(TimeNs now);
  void mpc_deliver();
  void frames_step(TimeNs now);
  void mapping_step(TimeNs now);
  void mapping_deliver();
  void perception_step(TimeNs now);
  void perception_deliver();
  void follow(const RequestStatus& status);
  void fill_snapshot();
  std::unique_ptr<SceneInterpreter> make_interpreter();

  DaemonConfig config_;
  std::shared_ptr<const RobotModel> model_;
  DriverHost host_;
  std::unique_ptr<TruthTap> truth_;  // oracle only
  Controller controller_;
  MotionPlanner planner_;
  Mapper mapper_;
  Perceiver perceiver_;
  Arrows arrows_;
  bool recording_ = false;
  bool advance_in_control_ = false;

  // control
  Readings readings_;
  RobotState state_;
  Reference reference_;
  ControlRecord control_record_;
  StateHash hash_;
  RequestStatus newest_status_;
  Opening opening_;
  // mpc
  MpcRecord mpc_record_;
  Weights weights_ = planner_.problem().weights().configured();  // in force
  bool mpc_pending_ = false, following_ = false, tuned_ = false;
  // frames
  std::uint64_t frame_seq_ = 0;
  int shoulder_camera_ = -1;
  DepthFrame frame_;
  // mapping
  MappingRecord mapping_record_;
  // perception
  RobotState perceived_state_;
  bool have_perceived_state_ = false, plan_pending_ = false;
};

}  // namespace wb
