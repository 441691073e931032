#include "control/task_sequencer.hpp"

#include <algorithm>
#include <cmath>

namespace wb {
namespace {

double angle(const Eigen::Matrix3d& R) { return Eigen::AngleAxisd(R).angle(); }

double wrap(double a) { return std::remainder(a, 2 * M_PI); }

}  // namespace

TaskSequencer::TaskSequencer(std::shared_ptr<const RobotModel> model,
                             const config::Section& section)
    : model_(std::move(model)) {
  using config::kFraction, config::kPositive;
  const config::Section t = section.section("time_limits");
  limits_ = {t.number("approach_s", kPositive), t.number("pre_grasp_s", kPositive),
             t.number("grasp_s", kPositive),    t.number("manipulate_s", kPositive),
             t.number("release_s", kPositive),  t.number("retreat_s", kPositive)};
  t.finish();
  pre_grasp_standoff_m_ = section.number("pre_grasp_standoff_m", kPositive);
  grasp_depth_m_ = section.number("grasp_depth_m");
  regrasp_step_m_ = section.number("regrasp_step_m", kPositive);
  probe_distance_m_ = section.number("probe_distance_m", kPositive);
  probe_held_n_ = section.number("probe_held_n", kPositive);
  grasp_tolerance_m_ = section.number("grasp_tolerance_m", kPositive);
  grasp_speed_mps_ = section.number("grasp_speed_mps", kPositive);
  retreat_distance_m_ = section.number("retreat_distance_m", kPositive);
  retreat_speed_mps_ = section.number("retreat_speed_mps", kPositive);
  if (model_->base_dof() > 0) {
    reach_distance_m_ = section.number("reach_distance_m", kPositive);
    base_tolerance_m_ = section.number("base_tolerance_m", kPositive);
    base_tolerance_rad_ = section.number("base_tolerance_rad", kPositive);
  }
  hand_tolerance_m_ = section.number("hand_tolerance_m", kPositive);
  hand_tolerance_rad_ = section.number("hand_tolerance_rad", kPositive);
  move_tolerance_m_ = section.number("move_tolerance_m", kPositive);
  move_tolerance_rad_ = section.number("move_tolerance_rad", kPositive);
  grip_force_n_ = section.number("grip_force_n", kPositive);
  grip_settle_s_ = section.number("grip_settle_s", kPositive);
  closed_margin_m_ = section.number("closed_margin_m", kPositive);
  slip_m_ = section.number("slip_m", kPositive);
  prismatic_speed_mps_ = section.number("prismatic_speed_mps", kPositive);
  revolute_speed_radps_ = section.number("revolute_speed_radps", kPositive);
  lag_max_m_ = section.number("lag_max_m", kPositive);
  lag_max_rad_ = section.number("lag_max_rad", kPositive);
  default_fraction_ = section.number("opened_fraction", kFraction);
  progress_timeout_s_ = section.number("progress_timeout_s", kPositive);
  section.finish();

  StateVector x = StateVector::Zero(model_->nx());
  for (int i = 0; i < model_->joints(); ++i) x[model_->base_dof() + i] = model_->config().ready[i];
  RobotModel::Data data;
  model_->forward_kinematics(x.data(), data);
  X_BE_ready_ = model_->X_WF(model_->end_effector(), data);
  if (model_->base_dof() == 0) measure_reach();
}

// From joint to joint to the hand: no arm is longer than the sum of its parts, so "too far" is
// never said of what can be reached.
void TaskSequencer::measure_reach() {
  const StateVector x = StateVector::Zero(model_->nx());
  RobotModel::Data data;
  model_->forward_kinematics(x.data(), data);
  p_BR_ = data.X_WL[1].translation();
  Eigen::Vector3d last = p_BR_;
  for (int i = 1; i <= model_->joints(); ++i) {
    const JointLimits& l = model_->limits(i - 1);
    const Eigen::Vector3d here = data.X_WL[i].translation();
    arm_reach_m_ += (here - last).norm();
    if (model_->prismatic(i)) arm_reach_m_ += std::max(std::abs(l.lower), std::abs(l.upper));
    last = here;
  }
  arm_reach_m_ += (model_->X_WF(model_->end_effector(), data).translation() - last).norm();
}

void TaskSequencer::start(const Request& request, const RobotState& state) RT_SAFE {
  request_ = request;
  if (request.kind == RequestKind::kMoveJoints)
    request_.base = state.base;  // the base stays where the task finds it
  have_plan_ = false;
  regrasps_ = 0;
  regrasp_offset_m_ = 0;
  why_ = Why::kNothing;
  held_ = false;
  regrasp_after_retreat_ = false;
  out_ = TaskOutput{};
  out_.gripper = {model_->config().gripper_opening_max_m, grip_force_n_};
  phase_ = Phase::kApproach;
  phase_start_ = state.t_ns;
  settled_since_ = 0;
}

void TaskSequencer::abort() RT_SAFE {
  phase_ = Phase::kNone;
  held_ = false;
}

void TaskSequencer::enter(Phase phase, const TaskInput& in) RT_SAFE {
  phase_ = phase;
  phase_start_ = in.t_ns;
  settled_since_ = 0;
  closing_ = probing_ = false;
  line_from_ = X_WE_;
}

// Before the hand touches anything the task just ends; after that it lets go and backs off first.
// The first trouble is the reason.
void TaskSequencer::fail(Why why, const TaskInput& in) RT_SAFE {
  if (why_ == Why::kNothing) why_ = why;
  Phase exit = Phase::kFailed;
  if (phase_ == Phase::kGrasp || phase_ == Phase::kManipulate) {
    regrasp_after_retreat_ = (why == Why::kMissed || why == Why::kSlipped) && regrasps_ == 0;
    if (regrasp_after_retreat_) ++regrasps_;
    exit = Phase::kRelease;
  } else if (phase_ == Phase::kRelease) {
    regrasp_after_retreat_ = false;  // a gripper that does not open cannot grasp again
    exit = Phase::kRetreat;
  }
  enter(exit, in);
}

bool TaskSequencer::adopt_plan(const TaskInput& in) RT_SAFE {
  // What was measured is not given up for a prior when the handle leaves the camera's view.
  const bool better = in.plan && (in.plan->measured || !have_plan_ || !plan_.measured);
  if (better && in.plan->object == request_.object && in.plan->keyframe_count > 1 &&
      in.plan->t_ns >= request_.t_ns) {
    plan_ = *in.plan;
    have_plan_ = true;
  }
  return have_plan_;
}

Eigen::Isometry3d TaskSequencer::hand_pose(double standoff_m) const RT_SAFE {
  // The first keyframe is the grasp; standing off means going back along the hand's approach axis.
  Eigen::Isometry3d X = plan_.keyframes[0].isometry();
  X.translation() -= standoff_m * X.linear().col(2);
  return X;
}

Eigen::Isometry3d TaskSequencer::keyframe_pose(double value) const RT_SAFE {
  const int n = plan_.keyframe_count;
  int i = 0;
  while (i < n - 2 && plan_.keyframe_value[i + 1] < value) ++i;
  const double span = plan_.keyframe_value[i + 1] - plan_.keyframe_value[i];
  // No span: the joint is as far open as it goes.
  const double s = span > 0 ? std::clamp((value - plan_.keyframe_value[i]) / span, 0.0, 1.0) : 0.0;
  const Pose &a = plan_.keyframes[i], &b = plan_.keyframes[i + 1];
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.linear() = a.rotation().slerp(s, b.rotation()).toRotationMatrix();
  X.translation() = (1 - s) * a.position() + s * b.position();
  return X;
}

double TaskSequencer::project(const Eigen::Isometry3d& X_WE) const RT_SAFE {
  const ArticulationEstimate& a = plan_.articulation;
  const Eigen::Vector3d axis = Eigen::Vector3d::Map(a.axis.data()),
                        origin = Eigen::Vector3d::Map(a.axis_origin.data());
  const Eigen::Vector3d start = (keyframe_pose(plan_.keyframe_value[0]) * X_KE_).translation();
  const Eigen::Vector3d now = X_WE.translation();
  if (a.kind == JointKind::kPrismatic) return plan_.keyframe_value[0] + axis.dot(now - start);
  const Eigen::Vector3d r0 = start - origin - axis * axis.dot(start - origin);
  const Eigen::Vector3d r1 = now - origin - axis * axis.dot(now - origin);
  return plan_.keyframe_value[0] + std::atan2(axis.dot(r0.cross(r1)), r0.dot(r1));
}

std::array<double, 3> TaskSequencer::base_goal() const RT_SAFE {
  // Where the base stands when the arm in its ready posture puts the hand at the pre-grasp pose, as
  // far as x, y and yaw go.
  const Eigen::Isometry3d X_WE = hand_pose(pre_grasp_standoff_m_);
  const Eigen::Vector3d approach_W = X_WE.linear().col(2), approach_B = X_BE_ready_.linear().col(2);
  const double yaw =
      std::atan2(approach_W.y(), approach_W.x()) - std::atan2(approach_B.y(), approach_B.x());
  const Eigen::Vector3d p = X_WE.translation() - Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                                                     X_BE_ready_.translation();
  return {p.x(), p.y(), yaw};
}

double TaskSequencer::opened_target() const RT_SAFE {
  const double fraction =
      request_.opened_fraction > 0 ? request_.opened_fraction : default_fraction_;
  return std::min(fraction * plan_.articulation.range,
                  plan_.keyframe_value[plan_.keyframe_count - 1]);
}

bool TaskSequencer::within_reach() const RT_SAFE {
  const auto reachable = [&](const Eigen::Isometry3d& X_WE) {
    return (X_WE.translation() - p_BR_).norm() < arm_reach_m_;  // W is B
  };
  return reachable(hand_pose(-grasp_depth_m_)) && reachable(keyframe_pose(opened_target()));
}

void TaskSequencer::hold_pose(const Pose& X_WE, TimeNs t, Reference& ref) const RT_SAFE {
  ref.ee[0].count = 1;
  ref.ee[0].keyframes[0] = {t, X_WE};
}

void TaskSequencer::line(const Eigen::Isometry3d& from, const Eigen::Isometry3d& to, TimeNs start,
                         double speed_mps, Reference& ref) const RT_SAFE {
  const double length = (to.translation() - from.translation()).norm();
  ref.ee[0].count = 2;
  ref.ee[0].keyframes[0] = {start, Pose::from(from)};
  ref.ee[0].keyframes[1] = {start + std::max<TimeNs>(from_seconds(length / speed_mps), 1'000'000),
                            Pose::from(to)};
}

double TaskSequencer::unwound(int joint, double wanted, double q) const RT_SAFE {
  return model_->limits(joint).endless() ? q + wrap(wanted - q) : wanted;
}

void TaskSequencer::set_posture(const std::vector<double>& q, double scale, const RobotState& s,
                                Reference& ref) const RT_SAFE {
  ref.joint_count = model_->joints();
  for (int i = 0; i < ref.joint_count; ++i) ref.posture[i] = unwound(i, q[i], s.q_command[i]);
  ref.posture_scale = scale;
}

void TaskSequencer::set_masks(double joint_value, Reference& ref) const RT_SAFE {
  ref.masks = plan_.masks;
  // The second box is the moving part: carry it along with the joint.
  MaskBox& moving = ref.masks[1];
  const ArticulationEstimate& a = plan_.articulation;
  const Eigen::Vector3d axis = Eigen::Vector3d::Map(a.axis.data()),
                        origin = Eigen::Vector3d::Map(a.axis_origin.data());
  const double change = joint_value - a.value;
  Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
  if (a.kind == JointKind::kPrismatic) {
    motion.translation() = change * axis;
  } else {
    motion = Eigen::Translation3d(origin) * Eigen::AngleAxisd(change, axis) *
             Eigen::Translation3d(-origin);
  }
  moving.X_WM = Pose::from(Eigen::Isometry3d(motion * moving.X_WM.isometry()));
}

void TaskSequencer::approach(const TaskInput& in, Reference& ref) RT_SAFE {
  const RobotConfig& robot = model_->config();
  if (!adopt_plan(in)) {
    set_posture(robot.stowed, 1.0, *in.state, ref);
    return;
  }
  if (model_->base_dof() == 0) {
    set_posture(robot.ready, 1.0, *in.state, ref);
    return within_reach() ? enter(Phase::kPreGrasp, in) : fail(Why::kOutOfReach, in);
  }
  const std::array<double, 3> goal = base_goal();
  const RobotState& s = *in.state;
  const double distance = std::hypot(goal[0] - s.base[0], goal[1] - s.base[1]);
  const double turn = std::abs(wrap(goal[2] - s.base[2]));
  ref.base_goal_active = true;
  ref.base_goal = goal;
  // The arm unfolds on the last stretch, when the robot already faces the object: no time is lost,
  // and nothing sticks out in turns.
  const bool unfold = distance < reach_distance_m_ && turn < 0.6;
  set_posture(unfold ? robot.ready : robot.stowed, 1.0, s, ref);
  if (distance < base_tolerance_m_ && turn < base_tolerance_rad_) enter(Phase::kPreGrasp, in);
}

void TaskSequencer::pre_grasp(const TaskInput& in, Reference& ref) RT_SAFE {
  adopt_plan(in);
  out_.gripper = {model_->config().gripper_opening_max_m, grip_force_n_};
  out_.joint_value = plan_.articulation.value;
  const Eigen::Isometry3d target = hand_pose(pre_grasp_standoff_m_);
  hold_pose(Pose::from(target), in.t_ns, ref);
  set_posture(model_->config().ready, 0.1, *in.state, ref);
  set_masks(plan_.articulation.value, ref);
  const bool there = plan_.measured &&
                     (X_WE_.translation() - target.translation()).norm() < hand_tolerance_m_ &&
                     angle(X_WE_.linear().transpose() * target.linear()) < hand_tolerance_rad_;
  if (!there) {
    settled_since_ = 0;
  } else if (settled_since_ == 0) {
    settled_since_ = in.t_ns;
  } else if (to_seconds(in.t_ns - settled_since_) > 0.1) {
    enter(Phase::kGrasp, in);
  }
}

void TaskSequencer::grasp(const TaskInput& in, Reference& ref) RT_SAFE {
  const RobotState& s = *in.state;
  const Eigen::Isometry3d target = hand_pose(regrasp_offset_m_ - grasp_depth_m_);
  line(line_from_, target, phase_start_, grasp_speed_mps_, ref);
  set_posture(model_->config().ready, 0.1, *in.state, ref);
  set_masks(plan_.articulation.value, ref);
  if (!closing_) {
    const TimeNs arrival = ref.ee[0].keyframes[1].t_ns;
    const bool there = (X_WE_.translation() - target.translation()).norm() < grasp_tolerance_m_;
    if (in.t_ns > arrival && there) {
      closing_ = true;
      closing_since_ = in.t_ns;
    }
    return;
  }
  out_.gripper = {0.0, grip_force_n_};
  if (probing_) {
    // Closed beside the bar. Pulling a little tells where it is: a bar that lies behind the pads
    // holds the hand back, one before their tips does not. The second try goes the other way.
    line(probe_from_, probe_from_ * Eigen::Translation3d(0, 0, -probe_distance_m_), probe_since_,
         grasp_speed_mps_, ref);
    probe_force_n_ = std::max(probe_force_n_, s.wrench[2]);
    if (in.t_ns < ref.ee[0].keyframes[1].t_ns + from_seconds(grip_settle_s_)) return;
    regrasp_offset_m_ = probe_force_n_ > probe_held_n_ ? regrasp_step_m_ : -regrasp_step_m_;
    return fail(Why::kMissed, in);
  }
  if (to_seconds(in.t_ns - closing_since_) < grip_settle_s_) return;
  if (s.gripper_opening_m < 2 * plan_.handle_radius_m - closed_margin_m_) {
    probe(in);
    return;
  }
  if (s.gripper_force_n < 0.5 * grip_force_n_)
    return;  // still closing; the phase's time limit bounds this
  held_ = true;
  X_KE_ = keyframe_pose(plan_.keyframe_value[0]).inverse() * X_WE_;
  value_ref_ = value_best_ = plan_.keyframe_value[0];
  target_ = opened_target();
  progress_t_ = in.t_ns;
  enter(Phase::kManipulate, in);
}

// The fingers closed beside the bar: pull a little and feel where it is.
void TaskSequencer::probe(const TaskInput& in) RT_SAFE {
  held_ = false;
  closing_ = probing_ = true;
  probe_from_ = X_WE_;
  probe_since_ = in.t_ns;
  probe_force_n_ = 0;
}

void TaskSequencer::manipulate(const TaskInput& in, Reference& ref) RT_SAFE {
  const RobotState& s = *in.state;
  const bool prismatic = plan_.articulation.kind == JointKind::kPrismatic;
  const double speed = prismatic ? prismatic_speed_mps_ : revolute_speed_radps_;
  const double lag = prismatic ? lag_max_m_ : lag_max_rad_;
  const double value = project(X_WE_);
  out_.joint_value = value;
  // The set-point runs ahead of the hand by no more than `lag`, so that a stuck joint meets a
  // bounded force.
  value_ref_ = std::min(
      {value_ref_ + speed * in.dt_s, std::max(value, plan_.keyframe_value[0]) + lag, target_});
  constexpr int kAhead = 12;
  ref.ee[0].count = kAhead;
  for (int i = 0; i < kAhead; ++i) {
    const double ahead_s = 0.35 * i;
    const double v = std::min(value_ref_ + speed * ahead_s, target_);
    ref.ee[0].keyframes[i] = {in.t_ns + from_seconds(ahead_s),
                              Pose::from(Eigen::Isometry3d(keyframe_pose(v) * X_KE_))};
  }
  set_posture(model_->config().ready, 0.1, *in.state, ref);
  set_masks(value, ref);
  const Eigen::Isometry3d X_a = keyframe_pose(value), X_b = keyframe_pose(value + 0.01);
  Eigen::Vector3d direction = (X_b * X_KE_).translation() - (X_a * X_KE_).translation();
  if (direction.norm() > 1e-6) out_.free_direction_W = direction.normalized();

  if (s.gripper_opening_m < 2 * plan_.handle_radius_m - closed_margin_m_) {
    if (to_seconds(in.t_ns - phase_start_) < grip_settle_s_) {  // it never was between the pads
      enter(Phase::kGrasp, in);
      return probe(in);
    }
    regrasp_offset_m_ = -regrasp_step_m_;  // it slid out over the pads' tips
    return fail(Why::kSlipped, in);
  }
  const Eigen::Vector3d off_path =
      X_WE_.translation() - (keyframe_pose(value) * X_KE_).translation();
  if (off_path.norm() > slip_m_) return fail(Why::kSlipped, in);
  if (value > value_best_ + 0.1 * lag) {
    value_best_ = value;
    progress_t_ = in.t_ns;
  }
  if (to_seconds(in.t_ns - progress_t_) > progress_timeout_s_) return fail(Why::kNoProgress, in);
  if (value >= target_ - 0.2 * lag) enter(Phase::kRelease, in);
}

void TaskSequencer::release(const TaskInput& in, Reference& ref) RT_SAFE {
  held_ = false;
  out_.gripper = {model_->config().gripper_opening_max_m, grip_force_n_};
  hold_pose(Pose::from(line_from_), in.t_ns, ref);
  set_posture(model_->config().ready, 0.1, *in.state, ref);
  set_masks(out_.joint_value, ref);
  if (in.state->gripper_opening_m > 0.8 * model_->config().gripper_opening_max_m)
    enter(Phase::kRetreat, in);
}

void TaskSequencer::retreat(const TaskInput& in, Reference& ref) RT_SAFE {
  Eigen::Isometry3d target = line_from_;
  target.translation() -= retreat_distance_m_ * line_from_.linear().col(2);
  line(line_from_, target, phase_start_, retreat_speed_mps_, ref);
  set_posture(model_->config().ready, 0.1, *in.state, ref);
  set_masks(out_.joint_value, ref);
  if ((X_WE_.translation() - target.translation()).norm() > 2 * hand_tolerance_m_) return;
  if (regrasp_after_retreat_) {
    regrasp_after_retreat_ = false;
    why_ = Why::kNothing;
    plan_.measured = false;  // look again before the second try
    enter(Phase::kPreGrasp, in);
  } else {
    phase_ = why_ == Why::kNothing ? Phase::kDone : Phase::kFailed;
  }
}

void TaskSequencer::move(const TaskInput& in, Reference& ref) RT_SAFE {
  const RobotState& s = *in.state;
  bool there = true;
  if (request_.kind == RequestKind::kMoveJoints) {
    ref.joint_count = model_->joints();
    ref.posture_scale = 300.0;  // the only objective of this task
    for (int i = 0; i < model_->joints(); ++i) {
      ref.posture[i] = unwound(i, request_.q[i], s.q_command[i]);
      there = there && std::abs(s.q[i] - unwound(i, request_.q[i], s.q[i])) < move_tolerance_rad_;
    }
    if (model_->base_dof() > 0) {
      ref.base_count = 1;
      ref.base[0] = {in.t_ns, request_.base};
      ref.base_scale = 0.1;
    }
  } else {
    ref.base_goal_active = true;
    ref.base_goal = request_.base;
    set_posture(model_->config().stowed, 1.0, s, ref);
    there = std::hypot(request_.base[0] - s.base[0], request_.base[1] - s.base[1]) <
                move_tolerance_m_ &&
            std::abs(wrap(request_.base[2] - s.base[2])) < move_tolerance_rad_;
  }
  if (there) phase_ = Phase::kDone;
}

TaskOutput TaskSequencer::step(const TaskInput& in, Reference& ref) RT_SAFE {
  out_.ended = false;
  if (phase_ == Phase::kNone) {
    out_.phase = phase_;
    out_.held = false;
    return out_;
  }
  const RobotState& s = *in.state;
  StateVector x(model_->nx());
  for (int i = 0; i < model_->base_dof(); ++i) x[i] = s.base[i];
  for (int i = 0; i < model_->joints(); ++i) x[model_->base_dof() + i] = s.q[i];
  RobotModel::Data data;
  model_->forward_kinematics(x.data(), data);
  X_WE_ = model_->X_WF(model_->end_effector(), data);

  ref = Reference{};
  ref.t_ns = in.t_ns;
  double limit_s = 0;
  switch (phase_) {
    case Phase::kApproach:
      limit_s = limits_.approach_s;
      break;
    case Phase::kPreGrasp:
      limit_s = limits_.pre_grasp_s;
      break;
    case Phase::kGrasp:
      limit_s = limits_.grasp_s;
      break;
    case Phase::kManipulate:
      limit_s = limits_.manipulate_s;
      break;
    case Phase::kRelease:
      limit_s = limits_.release_s;
      break;
    default:
      limit_s = limits_.retreat_s;
  }
  if (to_seconds(in.t_ns - phase_start_) > limit_s) {
    const bool no_plan = phase_ == Phase::kPreGrasp
                             ? !plan_.measured
                             : request_.kind == RequestKind::kOpen && !have_plan_;
    fail(no_plan ? Why::kNoPlan : Why::kTimeout, in);
  }
  switch (phase_) {
    case Phase::kApproach:
      request_.kind == RequestKind::kOpen ? approach(in, ref) : move(in, ref);
      break;
    case Phase::kPreGrasp:
      pre_grasp(in, ref);
      break;
    case Phase::kGrasp:
      grasp(in, ref);
      break;
    case Phase::kManipulate:
      manipulate(in, ref);
      break;
    case Phase::kRelease:
      release(in, ref);
      break;
    case Phase::kRetreat:
      retreat(in, ref);
      break;
    default:
      break;
  }
  out_.phase = phase_;
  out_.held = held_;
  out_.joint_range = have_plan_ ? plan_.articulation.range : 0;
  if (phase_ == Phase::kDone || phase_ == Phase::kFailed) {
    out_.ended = true;
    switch (why_) {
      case Why::kNothing:
        out_.failure = "";
        break;
      case Why::kTimeout:
        out_.failure = "time limit";
        break;
      case Why::kNoPlan:
        out_.failure = "object not found";
        break;
      case Why::kMissed:
        out_.failure = "grasp missed";
        break;
      case Why::kSlipped:
        out_.failure = "grasp slipped";
        break;
      case Why::kNoProgress:
        out_.failure = "object does not move";
        break;
      case Why::kOutOfReach:
        out_.failure = "out of reach";
        break;
    }
    phase_ = Phase::kNone;
    held_ = false;
  }
  return out_;
}

}  // namespace wb
