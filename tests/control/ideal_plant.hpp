// A world without dynamics for the sequencer: the hand is where the reference says (by inverse
// kinematics), the gripper closes at a constant speed and stops at the bar, and what the hand holds
// moves along its joint. Faults are switched on by the tests.
#pragma once
#include <Eigen/LU>
#include <algorithm>
#include <functional>
#include <vector>

#include "core/types/command.hpp"
#include "core/types/object_plan.hpp"
#include "core/types/readings.hpp"
#include "core/types/reference.hpp"
#include "perception/keyframe_generator.hpp"
#include "tests/control/robot.hpp"

namespace wb::control_test {

inline const std::array<double, 3> kAtOrigin{0, 0, 0};

// A unit whose handle lies `reach_m` in front of the hand when the base stands at `base` in the
// ready posture.
struct Unit {
  ArticulationEstimate joint;  // value: present
  Eigen::Isometry3d X_WG0;     // handle, closed
  Eigen::Isometry3d X_WM0;     // moving part's mask, closed
  Eigen::Vector3d x_E_W;       // which way the hand's x axis points
  static constexpr double kBarRadius = 0.008;

  Unit(JointKind kind, const Eigen::Vector3d& axis_B, const Eigen::Vector3d& axis_from_handle_B,
       double range, const std::array<double, 3>& base, double reach_m) {
    const Eigen::Isometry3d X_WB = planar_isometry(base[0], base[1], base[2]);
    const Eigen::Isometry3d X_BE = hand_pose(kAtOrigin, mabi()->config().ready.data());
    Eigen::Isometry3d X_BG = Eigen::Isometry3d::Identity();
    X_BG.linear() << 0, 0, 1, 1, 0, 0, 0, 1,
        0;  // x along the bar (to the left), y up, z into the front
    X_BG.translation() = X_BE.translation() + Eigen::Vector3d(reach_m, 0, 0);
    X_WG0 = X_WB * X_BG;
    X_WM0 = X_WG0 * Eigen::Translation3d(0, 0, 0.05);
    x_E_W = X_WB.linear() * X_BE.linear().col(0);
    joint.kind = kind;
    joint.range = range;
    Eigen::Vector3d::Map(joint.axis.data()) = X_WB.linear() * axis_B;
    Eigen::Vector3d::Map(joint.axis_origin.data()) =
        X_WG0.translation() + X_WB.linear() * axis_from_handle_B;
  }

  static Unit drawer(double range, const std::array<double, 3>& base, double reach_m = 0.1) {
    return {JointKind::kPrismatic, -Eigen::Vector3d::UnitX(), {0, 0, 0}, range, base, reach_m};
  }
  // Hinges to the left of the handle: the door swings towards the robot when it turns clockwise.
  static Unit side_door(const std::array<double, 3>& base) {
    return {JointKind::kRevolute, -Eigen::Vector3d::UnitZ(), {0, 0.5, 0}, 1.4, base, 0.1};
  }
  static Unit oven(const std::array<double, 3>& base) {
    return {JointKind::kRevolute, -Eigen::Vector3d::UnitY(), {0, 0, -0.4}, 1.2, base, 0.1};
  }

  Eigen::Isometry3d moved(const Eigen::Isometry3d& closed) const {
    ArticulationEstimate from_closed = joint;
    from_closed.value = 0;
    return KeyframeGenerator::pose_at(from_closed, closed, joint.value);
  }
  Eigen::Isometry3d X_WG() const { return moved(X_WG0); }

  ObjectPlan plan(TimeNs t, bool measured) const {
    ObjectPlan p;
    p.t_ns = t;
    p.object = Name("unit");
    p.measured = measured;
    p.articulation = joint;
    p.X_WG = Pose::from(X_WG());
    p.handle_radius_m = kBarRadius;
    p.handle_length_m = 0.2;
    p.masks[0] = {true, Pose::from(X_WM0), {0.3, 0.3, 0.3}};
    p.masks[1] = {true, Pose::from(moved(X_WM0)), {0.02, 0.3, 0.1}};
    KeyframeGenerator(x_E_W).generate(p);
    return p;
  }
};

class IdealPlant {
 public:
  explicit IdealPlant(const Unit& unit) : unit(unit) {}

  Unit unit;
  std::array<double, 3> base{0, 0, 0};
  std::vector<double> q = mabi()->config().stowed;
  double opening_m = 0.08, force_n = 0;
  // What works.
  bool base_moves = true, hand_follows = true, gripper_moves = true, bar_there = true,
       joint_moves = true;
  double joint_speed_max = 1e9;

  bool gripping() const {
    return bar_there && opening_m <= 2 * Unit::kBarRadius + 1e-9 &&
           (hand_pose(base, q.data()).translation() - unit.X_WG().translation()).norm() < 0.02;
  }

  void fill(RobotState& s) const {
    s.joint_count = mabi()->joints();
    s.base = base;
    std::copy(q.begin(), q.end(), s.q.begin());
    s.q_command = s.q;
    s.gripper_opening_m = opening_m;
    s.gripper_force_n = force_n;
  }
  // With the base at its start: wheels that never turned.
  void fill(Readings& r) const {
    r.joint_count = mabi()->joints();
    r.wheel_count = 2;
    for (int i = 0; i < r.joint_count; ++i) r.joints[i] = {q[i], 0, 0, 0, true};
    for (int i = 0; i < 2; ++i) r.wheels[i] = {0, 0, 0, 0, true};
    r.imu_valid = r.wrench_valid = r.gripper_valid = true;
    r.gripper_opening_m = opening_m;
    r.gripper_force_n = force_n;
  }

  void step(const Reference& ref, const GripperCommand& gripper, TimeNs t, double dt_s) {
    move_gripper(gripper, dt_s);
    if (ref.base_goal_active && base_moves) base = ref.base_goal;
    if (!hand_follows) return;
    if (ref.ee[0].count == 0) {
      q.assign(ref.posture.begin(), ref.posture.begin() + mabi()->joints());
      return;
    }
    const bool pulls = gripping();
    if (pulls && !joint_moves) return;
    const Eigen::Isometry3d before = hand_pose(base, q.data());
    Eigen::Isometry3d target = sample(ref, t);
    if (pulls) {  // the joint lets the hand have so much of its way
      const double way = travelled(before.translation(), target.translation());
      if (std::abs(way) > joint_speed_max * dt_s)
        target = towards(before, target, joint_speed_max * dt_s / std::abs(way));
    }
    reach(target);
    if (pulls)
      unit.joint.value += travelled(before.translation(), hand_pose(base, q.data()).translation());
  }

  // Between keyframes: linear position, spherical-linear rotation; held before the first and after
  // the last.
  static Eigen::Isometry3d sample(const Reference& ref, TimeNs t) {
    int i = 0;
    while (i < ref.ee[0].count - 1 && ref.ee[0].keyframes[i + 1].t_ns <= t) ++i;
    const Eigen::Isometry3d a = ref.ee[0].keyframes[i].X_WE.isometry();
    if (i == ref.ee[0].count - 1 || t <= ref.ee[0].keyframes[i].t_ns) return a;
    const double s =
        static_cast<double>(t - ref.ee[0].keyframes[i].t_ns) /
        static_cast<double>(ref.ee[0].keyframes[i + 1].t_ns - ref.ee[0].keyframes[i].t_ns);
    return towards(a, ref.ee[0].keyframes[i + 1].X_WE.isometry(), s);
  }

 private:
  static Eigen::Isometry3d towards(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b,
                                   double s) {
    return Pose::from((1 - s) * a.translation() + s * b.translation(),
                      Eigen::Quaterniond(a.linear()).slerp(s, Eigen::Quaterniond(b.linear())))
        .isometry();
  }

  void move_gripper(const GripperCommand& gripper, double dt_s) {
    if (!gripper_moves) return;
    const bool around_bar =
        bar_there &&
        (hand_pose(base, q.data()).translation() - unit.X_WG().translation()).norm() < 0.02;
    const double stop = around_bar ? 2 * Unit::kBarRadius : 0.0, step = 0.2 * dt_s;
    const double target = std::max(gripper.opening_m, std::min(stop, opening_m));
    opening_m += std::clamp(target - opening_m, -step, step);
    force_n =
        opening_m > gripper.opening_m + 1e-9 && opening_m <= stop + 1e-9 ? gripper.force_n : 0.0;
  }

  // Change of the joint's value when its handle moves from a to b.
  double travelled(const Eigen::Vector3d& a, const Eigen::Vector3d& b) const {
    const Eigen::Vector3d axis = Eigen::Vector3d::Map(unit.joint.axis.data());
    if (unit.joint.kind == JointKind::kPrismatic) return axis.dot(b - a);
    const Eigen::Vector3d origin = Eigen::Vector3d::Map(unit.joint.axis_origin.data());
    const Eigen::Matrix3d flat = Eigen::Matrix3d::Identity() - axis * axis.transpose();
    const Eigen::Vector3d ra = flat * (a - origin), rb = flat * (b - origin);
    return std::atan2(axis.dot(ra.cross(rb)), ra.dot(rb));
  }

  // Newton on all of x; the base may move sideways, which no reference of a task forbids.
  void reach(const Eigen::Isometry3d& target) {
    StateVector x = state_vector(base, q.data());
    RobotModel::Data data;
    for (int i = 0; i < 100; ++i) {
      mabi()->forward_kinematics(x.data(), data);
      const Eigen::Isometry3d X_WE = mabi()->X_WF(mabi()->end_effector(), data);
      const Eigen::AngleAxisd turn(Eigen::Matrix3d(target.linear() * X_WE.linear().transpose()));
      Eigen::Matrix<double, 6, 1> error;
      error << target.translation() - X_WE.translation(), turn.angle() * turn.axis();
      if (error.norm() < 1e-9) break;
      Jacobian J;
      mabi()->frame_jacobian(mabi()->end_effector(), data, J);
      if (!base_moves) J.leftCols<3>().setZero();
      Eigen::Matrix<double, 6, 6> A = J * J.transpose();
      A.diagonal().array() += 1e-6;
      x += J.transpose() * A.inverse() * error;
    }
    for (int i = 0; i < 3; ++i) base[i] = x[i];
    for (int i = 0; i < mabi()->joints(); ++i) q[i] = x[3 + i];
  }
};

}  // namespace wb::control_test
