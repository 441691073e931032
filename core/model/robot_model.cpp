#include "core/model/robot_model.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

#include "core/config/config.hpp"
#include "core/model/urdf_file.hpp"
#include "core/types/pose.hpp"

namespace wb {
namespace {

constexpr double kGravity = 9.81;  // m/s^2

// Inertia about its centre of mass of a point mass at distance d from it.
Eigen::Matrix3d point_inertia(double mass, const Eigen::Vector3d& d) {
  return mass * (d.squaredNorm() * Eigen::Matrix3d::Identity() - d * d.transpose());
}

Eigen::Matrix3d rotation(double angle, const Eigen::Vector3d& axis) {
  return Eigen::AngleAxisd(angle, axis).toRotationMatrix();
}

}  // namespace

RobotModel::RobotModel(const RobotConfig& config) : config_(config) {
  const urdf::ModelInterfaceSharedPtr urdf = read_urdf(config.urdf);
  bodies_.resize(config.joints.size() + 1);
  constexpr double kEndless = std::numeric_limits<double>::infinity();
  for (const JointConfig& joint : config.joints) {
    const urdf::Joint& j = *urdf->getJoint(joint.name);
    const urdf::JointLimits& l = *j.limits;
    const bool endless = j.type == urdf::Joint::CONTINUOUS;
    limits_.push_back({endless ? -kEndless : l.lower, endless ? kEndless : l.upper,
                       joint.velocity_max > 0 ? joint.velocity_max : l.velocity, l.effort,
                       joint.acceleration_max});
  }
  Frame root;
  root.name = urdf->getRoot()->name;
  add_link(*urdf->getRoot(), root);
  for (std::size_t i = 0; i < config.joints.size(); ++i) {
    if (bodies_[i + 1].mass <= 0) {
      throw config::ConfigError(config.urdf.string() + ": joint " + config.joints[i].name +
                                " moves no mass");
    }
  }
  for (const Body& body : bodies_) mass_ += body.mass;
  end_effectors_.push_back(frame(config.end_effector));
  for (const std::string& link : config.more_end_effectors) end_effectors_.push_back(frame(link));

  for (const SphereConfig& s : config.spheres) {
    const Frame& f = frames_[frame(s.link)];
    spheres_.push_back({f.body, f.X_LF * s.centre, s.radius, s.masked});
  }
  for (const CapsuleConfig& c : config.capsules) {
    const Frame& f = frames_[frame(c.link)];
    capsules_.push_back({c.name, f.body, f.X_LF * c.p0, f.X_LF * c.p1, c.radius});
  }
  const auto capsule = [&](const std::string& name) {
    return static_cast<int>(std::find_if(capsules_.begin(), capsules_.end(),
                                         [&](const Capsule& c) { return c.name == name; }) -
                            capsules_.begin());
  };
  for (const auto& pair : config.self_pairs) {
    self_pairs_.push_back({capsule(pair[0]), capsule(pair[1])});
  }
}

// Adds a link to its body, then the links that it carries.
void RobotModel::add_link(const urdf::Link& link, Frame frame) {
  if (link.inertial) {
    const urdf::Inertial& in = *link.inertial;
    const Eigen::Isometry3d X_FI = to_eigen(in.origin);
    frame.mass = in.mass;
    frame.com = X_FI.translation();
    Eigen::Matrix3d I;
    I << in.ixx, in.ixy, in.ixz, in.ixy, in.iyy, in.iyz, in.ixz, in.iyz, in.izz;
    if (in.mass <= 0 || Eigen::LLT<Eigen::Matrix3d>(I).info() != Eigen::Success) {
      throw config::ConfigError(config_.urdf.string() + ": the inertia of link " + link.name +
                                " is not positive");
    }
    const Eigen::Isometry3d X_LI = frame.X_LF * X_FI;
    Body& body = bodies_[frame.body];
    const double mass = body.mass + in.mass;
    const Eigen::Vector3d d = X_LI.translation() - body.com;
    body.inertia += X_LI.linear() * I * X_LI.linear().transpose() +
                    point_inertia(body.mass * in.mass / mass, d);
    body.com += in.mass / mass * d;
    body.mass = mass;
  }
  const int index = static_cast<int>(frames_.size());
  frames_.push_back(frame);

  for (const urdf::LinkSharedPtr& child : link.child_links) {
    const urdf::JointSharedPtr& joint = child->parent_joint;
    const std::string& moved_by = joint->mimic ? joint->mimic->joint_name : joint->name;
    const auto listed = std::find_if(config_.joints.begin(), config_.joints.end(),
                                     [&](const JointConfig& j) { return j.name == moved_by; });
    Frame next;
    next.name = child->name;
    next.parent = index;
    const Eigen::Isometry3d X_LJ = frame.X_LF * to_eigen(joint->parent_to_joint_origin_transform);
    if (listed == config_.joints.end()) {
      next.body = frame.body;
      next.X_LF = X_LJ;
    } else {
      const int q = static_cast<int>(listed - config_.joints.begin());
      next.body = joint->mimic ? static_cast<int>(bodies_.size()) : q + 1;
      if (joint->mimic) bodies_.emplace_back();
      if (next.body >= kMaxBodies) {
        throw config::ConfigError(config_.urdf.string() + ": more than " +
                                  std::to_string(kMaxMimics) + " mimic joints");
      }
      order_.push_back(next.body);
      const Eigen::Vector3d axis = to_eigen(joint->axis);
      if (!(axis.norm() > 0)) {
        throw config::ConfigError(config_.urdf.string() + ": joint " + joint->name +
                                  " has no axis");
      }
      Body& body = bodies_[next.body];
      body.parent = frame.body;
      body.joint = q;
      if (joint->mimic) {
        body.multiplier = joint->mimic->multiplier;
        body.offset = joint->mimic->offset;
      }
      body.X_PJ = X_LJ;
      body.axis = axis.normalized();
      body.prismatic = joint->type == urdf::Joint::PRISMATIC;
    }
    add_link(*child, next);
  }
}

int RobotModel::frame(std::string_view link) const {
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    if (frames_[i].name == link) return static_cast<int>(i);
  }
  throw config::ConfigError(config_.urdf.string() + ": has no link '" + std::string(link) + "'");
}

void RobotModel::forward_kinematics(const double* x, Data& data) const noexcept {
  if (base_dof() > 0) {
    data.X_WL[0] = planar_isometry(x[0], x[1], x[2]);
  } else {
    data.X_WL[0].setIdentity();
  }
  data.axis_W[0] = Eigen::Vector3d::UnitZ();
  place_joints(x + base_dof(), data);
}

void RobotModel::place_joints(const double* q, Data& data) const noexcept {
  for (const int i : order_) {
    const Body& body = bodies_[i];
    const double value = body.multiplier * q[body.joint] + body.offset;
    const Eigen::Isometry3d& X_WP = data.X_WL[body.parent];
    Eigen::Isometry3d& X_WL = data.X_WL[i];
    X_WL = X_WP * body.X_PJ;
    data.axis_W[i].noalias() = X_WL.linear() * body.axis;
    if (body.prismatic) {
      X_WL.translation() += value * data.axis_W[i];
    } else {
      X_WL.linear() = Eigen::Matrix3d(X_WL.linear()) * rotation(value, body.axis);
    }
  }
}

Eigen::Isometry3d RobotModel::X_WF(int frame, const Data& data) const noexcept {
  return data.X_WL[frames_[frame].body] * frames_[frame].X_LF;
}

void RobotModel::frame_jacobian(int frame, const Data& data, Jacobian& J) const noexcept {
  const Frame& f = frames_[frame];
  PointJacobian linear;
  point_jacobian(f.body, data.X_WL[f.body] * f.X_LF.translation(), data, linear);
  J.resize(6, nx());
  J.topRows<3>() = linear;
  J.bottomRows<3>().setZero();
  const int base = base_dof();
  if (base > 0) J(5, 2) = 1;
  for (int i = f.body; i > 0; i = bodies_[i].parent) {
    const Body& body = bodies_[i];
    if (!body.prismatic) J.col(base + body.joint).tail<3>() += body.multiplier * data.axis_W[i];
  }
}

void RobotModel::point_jacobian(int body, const Eigen::Vector3d& p_W, const Data& data,
                                PointJacobian& J) const noexcept {
  J.setZero(3, nx());
  const int base = base_dof();
  if (base > 0) {
    const Eigen::Vector3d r = p_W - data.X_WL[0].translation();
    J(0, 0) = 1;
    J(1, 1) = 1;
    J(0, 2) = -r.y();
    J(1, 2) = r.x();
  }
  for (int i = body; i > 0; i = bodies_[i].parent) {
    const Body& b = bodies_[i];
    if (b.prismatic) {
      J.col(base + b.joint) += b.multiplier * data.axis_W[i];
    } else {
      J.col(base + b.joint) +=
          b.multiplier * data.axis_W[i].cross(p_W - data.X_WL[i].translation());
    }
  }
}

// Recursive Newton-Euler in W's axes, moments about each body's origin.
void RobotModel::newton_euler(const Data& data, const double* dq, const double* ddq, double lift,
                              double* tau) const noexcept {
  using Vectors = std::array<Eigen::Vector3d, kMaxBodies>;
  Vectors w, alpha, a, force, moment;  // of body i: angular rate, its derivative, acceleration
  w[0].setZero();
  alpha[0].setZero();
  a[0] = Eigen::Vector3d(0, 0, lift);
  for (const int i : order_) {
    const Body& body = bodies_[i];
    const int p = body.parent;
    const Eigen::Vector3d r = data.X_WL[i].translation() - data.X_WL[p].translation();
    const Eigen::Vector3d rate = (dq ? body.multiplier * dq[body.joint] : 0.0) * data.axis_W[i];
    const Eigen::Vector3d drate = (ddq ? body.multiplier * ddq[body.joint] : 0.0) * data.axis_W[i];
    a[i] = a[p] + alpha[p].cross(r) + w[p].cross(w[p].cross(r));
    w[i] = w[p];
    alpha[i] = alpha[p];
    if (body.prismatic) {
      a[i] += drate + 2 * w[p].cross(rate);
    } else {
      w[i] += rate;
      alpha[i] += drate + w[p].cross(rate);
    }
    const Eigen::Matrix3d R = data.X_WL[i].linear();
    const Eigen::Vector3d c = R * body.com;
    force[i] = body.mass * (a[i] + alpha[i].cross(c) + w[i].cross(w[i].cross(c)));
    const Eigen::Vector3d w_L = R.transpose() * w[i];
    const Eigen::Vector3d alpha_L = R.transpose() * alpha[i];
    moment[i] = R * (body.inertia * alpha_L + w_L.cross(body.inertia * w_L)) + c.cross(force[i]);
  }
  std::fill_n(tau, joints(), 0.0);
  for (auto it = order_.rbegin(); it != order_.rend(); ++it) {
    const int i = *it;
    const Body& body = bodies_[i];
    tau[body.joint] += body.multiplier * data.axis_W[i].dot(body.prismatic ? force[i] : moment[i]);
    const int p = body.parent;
    if (p == 0) continue;
    const Eigen::Vector3d r = data.X_WL[i].translation() - data.X_WL[p].translation();
    force[p] += force[i];
    moment[p] += moment[i] + r.cross(force[i]);
  }
}

void RobotModel::inverse_dynamics(const double* q, const double* dq, const double* ddq,
                                  JointVector& tau) const noexcept {
  Data data;
  data.X_WL[0].setIdentity();
  place_joints(q, data);
  tau.resize(joints());
  newton_euler(data, dq, ddq, kGravity, tau.data());
}

void RobotModel::gravity(const double* q, JointVector& tau) const noexcept {
  inverse_dynamics(q, nullptr, nullptr, tau);
}

// Column j holds the torques of a unit acceleration of joint j without gravity.
void RobotModel::mass_matrix(const double* q, JointMatrix& M) const noexcept {
  Data data;
  data.X_WL[0].setIdentity();
  place_joints(q, data);
  const int n = joints();
  M.resize(n, n);
  std::array<double, kMaxJoints> ddq{};
  for (int j = 0; j < n; ++j) {
    ddq[j] = 1;
    newton_euler(data, nullptr, ddq.data(), 0, M.col(j).data());
    ddq[j] = 0;
    for (int i = 0; i < j; ++i) M(i, j) = M(j, i);  // exactly symmetric
  }
}

void RobotModel::subtrees(const Data& data, Subtrees& out) const noexcept {
  const int bodies = static_cast<int>(bodies_.size());
  for (int i = 0; i < bodies; ++i) {
    out.mass[i] = bodies_[i].mass;
    out.com_W[i] = bodies_[i].mass * (data.X_WL[i] * bodies_[i].com);
  }
  for (auto i = order_.rbegin(); i != order_.rend(); ++i) {
    out.mass[bodies_[*i].parent] += out.mass[*i];
    out.com_W[bodies_[*i].parent] += out.com_W[*i];
  }
  for (int i = 0; i < bodies; ++i) {
    if (out.mass[i] > 0) out.com_W[i] /= out.mass[i];
  }
}

double RobotModel::mass_beyond(int frame, Eigen::Vector3d& com_F) const {
  const Eigen::Isometry3d X_FL = frames_[frame].X_LF.inverse();
  double mass = 0;
  com_F.setZero();
  for (const Frame& f : frames_) {
    const Frame* up = &f;
    while (up != &frames_[frame] && up->parent >= 0) up = &frames_[up->parent];
    if (up != &frames_[frame] || f.body != frames_[frame].body) continue;
    mass += f.mass;
    com_F += f.mass * (X_FL * f.X_LF * f.com);
  }
  if (mass > 0) com_F /= mass;
  return mass;
}

}  // namespace wb
