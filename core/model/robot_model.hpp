// Kinematics and dynamics of a robot from its URDF: a fixed or wheeled base under a tree of joints.
// The model is immutable; each thread owns its Data. Every const method is a step: noexcept, no
// allocation. x = (base x, y, yaw; q) with base_dof() = 0 or 3, u = (base_inputs() velocities; dq).
// Jacobians: 6 x nx, linear over angular, in W, with respect to x. Source: Featherstone 2008, Rigid
// Body Dynamics Algorithms (RNEA, Sec. 5.3).
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "core/model/robot_config.hpp"
#include "core/types/limits.hpp"

namespace urdf {
class Link;
}

namespace wb {

using StateVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxStates, 1>;
using JointVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxJoints, 1>;
using Jacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxStates>;
using PointJacobian = Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, kMaxStates>;
using JointMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxJoints, kMaxJoints>;

struct JointLimits {
  double lower = 0, upper = 0;  // rad or m; of a continuous joint -inf and inf
  double velocity = 0;          // rad/s or m/s
  double torque = 0;            // Nm or N
  double acceleration = 0;      // rad/s^2 or m/s^2, from robot.yaml

  bool endless() const { return lower == -std::numeric_limits<double>::infinity(); }
};

struct Sphere {
  int body = 0;            // index into the model's bodies
  Eigen::Vector3d centre;  // in the body's frame
  double radius = 0;
  bool masked = false;
};

struct Capsule {
  std::string name;
  int body = 0;
  Eigen::Vector3d p0, p1;  // in the body's frame
  double radius = 0;
};

class RobotModel {
 public:
  static constexpr int kMaxMimics = 8;
  static constexpr int kMaxBodies = 1 + kMaxJoints + kMaxMimics;

  // Poses and scratch of one configuration; fixed size, no heap.
  struct Data {
    // Body frames: body 0 is the base, body i is moved by joint i - 1, those after the last joint
    // by mimic joints.
    std::array<Eigen::Isometry3d, kMaxBodies> X_WL;
    std::array<Eigen::Vector3d, kMaxBodies> axis_W;  // of the joint that moves the body
  };

  // Fixed children are merged; movable joints that robot.yaml does not list (wheels, fingers) are
  // locked at zero, except that a mimic joint follows its master, if that is listed. Throws
  // config::ConfigError with the URDF's file and the link or joint at fault.
  explicit RobotModel(const RobotConfig& config);

  const RobotConfig& config() const { return config_; }
  int base_dof() const { return config_.base.kind == BaseKind::kFixed ? 0 : 3; }
  int joints() const { return static_cast<int>(limits_.size()); }
  int nx() const { return base_dof() + joints(); }
  // Base velocities among the inputs: none; v, w of a differential drive; vx, vy, w in B.
  int base_inputs() const {
    return config_.base.kind == BaseKind::kFixed               ? 0
           : config_.base.kind == BaseKind::kDifferentialDrive ? 2
                                                               : 3;
  }
  int nu() const { return base_inputs() + joints(); }
  const JointLimits& limits(int joint) const { return limits_[joint]; }
  double mass() const { return mass_; }

  // Frames are URDF links, also merged ones. frame() throws for an unknown name (setup only).
  int frame(std::string_view link) const;
  // Frames that a Reference may lead: 0 is E, then robot.yaml's more_end_effectors.
  int end_effectors() const { return static_cast<int>(end_effectors_.size()); }
  int end_effector(int k = 0) const { return end_effectors_[k]; }

  // The tree: body 0 is the base, every other one is moved by ratio(body) times the rate of
  // joint_of(body); the ratio is 1 except for mimic joints.
  int bodies() const { return static_cast<int>(bodies_.size()); }
  int frame_body(int frame) const { return frames_[frame].body; }
  int parent(int body) const { return bodies_[body].parent; }
  int joint_of(int body) const { return bodies_[body].joint; }
  double ratio(int body) const { return bodies_[body].multiplier; }
  bool prismatic(int body) const { return bodies_[body].prismatic; }

  void forward_kinematics(const double* x, Data& data) const noexcept;  // x has nx() entries
  Eigen::Isometry3d X_WF(int frame, const Data& data) const noexcept;
  void frame_jacobian(int frame, const Data& data, Jacobian& J_WF) const noexcept;
  // Jacobian of the point p_L fixed to a body; `p_W` is its position.
  void point_jacobian(int body, const Eigen::Vector3d& p_W, const Data& data,
                      PointJacobian& J) const noexcept;

  // Joint torques for accelerations ddq with the base at rest: tau = M(q) ddq + c(q, dq) + g(q).
  // Inputs: joints() entries.
  void inverse_dynamics(const double* q, const double* dq, const double* ddq,
                        JointVector& tau) const noexcept;
  void gravity(const double* q, JointVector& tau) const noexcept;
  void mass_matrix(const double* q, JointMatrix& M) const noexcept;

  // Masses and centres of mass (in W) of each body together with all beyond it.
  struct Subtrees {
    std::array<double, kMaxBodies> mass;
    std::array<Eigen::Vector3d, kMaxBodies> com_W;
  };
  void subtrees(const Data& data, Subtrees& out) const noexcept;

  const std::vector<Sphere>& spheres() const { return spheres_; }
  const std::vector<Capsule>& capsules() const { return capsules_; }
  const std::vector<std::array<int, 2>>& self_pairs() const { return self_pairs_; }

  // Mass [kg] and centre of mass (in F) of everything rigidly attached beyond a frame (the hand's
  // weight on the wrist sensor).
  double mass_beyond(int frame, Eigen::Vector3d& com_F) const;

 private:
  struct Body {
    int parent = -1;
    int joint = -1;                     // moved by multiplier * q[joint] + offset
    double multiplier = 1, offset = 0;  // of a mimic joint
    Eigen::Isometry3d X_PJ = Eigen::Isometry3d::Identity();  // parent body to joint frame at zero
    Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
    bool prismatic = false;
    double mass = 0;
    Eigen::Vector3d com = Eigen::Vector3d::Zero();      // in the body's frame
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  // about the com, in the body's axes
  };
  struct Frame {  // a URDF link
    std::string name;
    int parent = -1;  // frame
    int body = 0;
    Eigen::Isometry3d X_LF = Eigen::Isometry3d::Identity();
    double mass = 0;                                // of this link alone
    Eigen::Vector3d com = Eigen::Vector3d::Zero();  // in F
  };

  void add_link(const urdf::Link& link, Frame frame);
  void place_joints(const double* q, Data& data) const noexcept;  // from X_WL[0]
  // Torques from a base at rest that accelerates upwards at `lift` [m/s^2], which stands for
  // gravity; dq, ddq may be null.
  void newton_euler(const Data& data, const double* dq, const double* ddq, double lift,
                    double* tau) const noexcept;

  RobotConfig config_;
  std::vector<Body> bodies_;
  std::vector<int> order_;  // all bodies but the base, parents before children
  std::vector<Frame> frames_;
  std::vector<JointLimits> limits_;
  std::vector<Sphere> spheres_;
  std::vector<Capsule> capsules_;
  std::vector<std::array<int, 2>> self_pairs_;
  double mass_ = 0;
  std::vector<int> end_effectors_;
};

}  // namespace wb
