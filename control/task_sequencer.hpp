// Runs a task phase by phase: approach, pre-grasp, grasp, manipulate, release, retreat. Control
// loop, step world. Each phase has a success condition, a time limit and a failure exit
// (docs/architecture.md has the table); a missed or slipped grasp is tried once more. Writes the
// MPC's Reference and the gripper command. Frames: W, B, E; X_WG handle. SI. Source: Mittal et al.
// 2022, Sec. III-C (keyframes along or about the joint axis).
#pragma once
#include <memory>

#include "core/config/config.hpp"
#include "core/model/robot_model.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/command.hpp"
#include "core/types/object_plan.hpp"
#include "core/types/reference.hpp"
#include "core/types/request.hpp"
#include "core/types/robot_state.hpp"

namespace wb {

struct TaskInput {
  TimeNs t_ns = 0;
  double dt_s = 0;
  const RobotState* state = nullptr;
  const ObjectPlan* plan = nullptr;  // newest, or null
};

struct TaskOutput {
  Phase phase = Phase::kNone;
  GripperCommand gripper;
  bool held = false;  // the handle is in the hand: admittance on
  Eigen::Vector3d free_direction_W{0, 0, 0};
  double joint_value = 0;  // of the object, from the hand's pose while held; rad or m
  double joint_range = 0;
  bool ended = false;        // this tick ended the task: kDone or kFailed
  std::string_view failure;  // why, when kFailed
};

class TaskSequencer {
 public:
  TaskSequencer(std::shared_ptr<const RobotModel> model, const config::Section& section);

  // Starts a task (kOpen, kMoveJoints, kMoveBase); an unfinished one is dropped where it stands.
  void start(const Request& request, const RobotState& state) RT_SAFE;
  // Drops the task; the gripper stays as it is.
  void abort() RT_SAFE;
  bool busy() const { return phase_ != Phase::kNone; }

  // One tick; `reference` is overwritten while a task runs.
  TaskOutput step(const TaskInput& in, Reference& reference) RT_SAFE;

 private:
  enum class Why : std::uint8_t {
    kNothing,
    kTimeout,
    kNoPlan,
    kMissed,
    kSlipped,
    kNoProgress,
    kOutOfReach,
  };
  struct Limits {
    double approach_s, pre_grasp_s, grasp_s, manipulate_s, release_s, retreat_s;
  };

  void enter(Phase phase, const TaskInput& in) RT_SAFE;
  void fail(Why why, const TaskInput& in) RT_SAFE;  // into the failure exit of the present phase
  bool adopt_plan(const TaskInput& in) RT_SAFE;
  void approach(const TaskInput& in, Reference& ref) RT_SAFE;
  void pre_grasp(const TaskInput& in, Reference& ref) RT_SAFE;
  void grasp(const TaskInput& in, Reference& ref) RT_SAFE;
  void probe(const TaskInput& in) RT_SAFE;
  void manipulate(const TaskInput& in, Reference& ref) RT_SAFE;
  void release(const TaskInput& in, Reference& ref) RT_SAFE;
  void retreat(const TaskInput& in, Reference& ref) RT_SAFE;
  void move(const TaskInput& in, Reference& ref) RT_SAFE;

  Eigen::Isometry3d X_WG() const RT_SAFE { return plan_.X_WG.isometry(); }
  // Hand pose with its z axis into the front and its fingers across the bar, `standoff_m` before
  // the handle.
  Eigen::Isometry3d hand_pose(double standoff_m) const RT_SAFE;
  Eigen::Isometry3d keyframe_pose(double value) const RT_SAFE;  // X_WE of the plan at a joint value
  double project(
      const Eigen::Isometry3d& X_WE) const RT_SAFE;  // joint value that the hand's pose shows
  std::array<double, 3> base_goal() const RT_SAFE;
  bool within_reach() const RT_SAFE;  // a fixed robot's: the whole way of the hand, as far as known
  double opened_target() const RT_SAFE;
  void hold_pose(const Pose& X_WE, TimeNs t, Reference& ref) const RT_SAFE;
  void line(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to, TimeNs start,
            double speed_mps, Reference& ref) const RT_SAFE;
  // The whole turn of a continuous joint that is nearest to `q`.
  double unwound(int joint, double wanted, double q) const RT_SAFE;
  void measure_reach();
  void set_posture(const std::vector<double>& q, double scale, const RobotState& s,
                   Reference& ref) const RT_SAFE;
  void set_masks(double joint_value, Reference& ref) const RT_SAFE;

  std::shared_ptr<const RobotModel> model_;
  Limits limits_;
  double pre_grasp_standoff_m_, grasp_depth_m_, regrasp_step_m_, probe_distance_m_, probe_held_n_,
      grasp_tolerance_m_, grasp_speed_mps_, retreat_distance_m_, retreat_speed_mps_;
  double reach_distance_m_ = 0, base_tolerance_m_ = 0, base_tolerance_rad_ = 0;  // if it drives
  double hand_tolerance_m_, hand_tolerance_rad_;
  double move_tolerance_m_, move_tolerance_rad_;
  double grip_force_n_, grip_settle_s_, closed_margin_m_, slip_m_;
  double prismatic_speed_mps_, revolute_speed_radps_, lag_max_m_, lag_max_rad_, default_fraction_,
      progress_timeout_s_;
  Eigen::Isometry3d X_BE_ready_;
  Eigen::Vector3d p_BR_{0, 0, 0};  // where a fixed robot's arm begins ...
  double arm_reach_m_ = 0;         // ... and how far its hand gets from there

  Phase phase_ = Phase::kNone;
  Request request_;
  ObjectPlan plan_;
  bool have_plan_ = false;
  TimeNs phase_start_ = 0;
  int regrasps_ = 0;
  double regrasp_offset_m_ = 0;  // how much further out than planned the second try closes
  Why why_ = Why::kNothing;
  bool held_ = false;
  bool regrasp_after_retreat_ = false;
  TaskOutput out_;
  // Of the present phase.
  Eigen::Isometry3d X_WE_ = Eigen::Isometry3d::Identity();  // measured hand pose of this tick
  Eigen::Isometry3d line_from_ = Eigen::Isometry3d::Identity();
  bool closing_ = false;
  TimeNs closing_since_ = 0;
  bool probing_ = false;
  Eigen::Isometry3d probe_from_ = Eigen::Isometry3d::Identity();
  TimeNs probe_since_ = 0;
  double probe_force_n_ = 0;
  Eigen::Isometry3d X_KE_ =
      Eigen::Isometry3d::Identity();  // keyframe to hand: how the handle lies in the hand
  double value_ref_ = 0, value_best_ = 0, target_ = 0;
  TimeNs progress_t_ = 0;
  TimeNs settled_since_ = 0;
};

}  // namespace wb
