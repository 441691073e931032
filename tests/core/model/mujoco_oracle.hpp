// The same URDF in MuJoCo, as an independent oracle: nothing fused, the root on a free joint. Setup
// world; SI units, frame W.
#pragma once
#include <mujoco/mujoco.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cstring>
#include <fstream>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>

#include "core/model/robot_model.hpp"
#include "core/model/urdf_file.hpp"

namespace wb::test {

class MujocoOracle {
 public:
  // In a URDF of MuJoCo's kind the root hangs on a link named `world`; inertias must not be guessed
  // from geometry.
  explicit MujocoOracle(const RobotConfig& config) : config_(config) {
    std::ifstream in(config.urdf);
    std::stringstream buffer;
    buffer << in.rdbuf();
    std::string text = buffer.str();
    text.insert(text.find('>', text.find("<robot name")) + 1,
                R"(<mujoco><compiler inertiafromgeom="false" fusestatic="false"/></mujoco>
                   <link name="world"/><joint name="root" type="floating"><parent link="world"/><child link=")" +
                    config.base.link + R"("/></joint>)");
    const auto files = std::make_unique<mjVFS>();
    mj_defaultVFS(files.get());
    mj_makeEmptyFileVFS(files.get(), "robot.urdf", static_cast<int>(text.size()));
    std::memcpy(files->filedata[0], text.data(), text.size());
    char error[1000] = "";
    model_.reset(mj_loadXML("robot.urdf", files.get(), error, sizeof error));
    mj_deleteVFS(files.get());
    if (!model_) throw std::runtime_error(error);
    mju_zero(model_->dof_armature, model_->nv);
    set_inertias();
    data_.reset(mj_makeData(model_.get()));
    const urdf::ModelInterfaceSharedPtr urdf = read_urdf(config.urdf);
    for (const JointConfig& joint : config.joints) {
      followers_.push_back({{id(mjOBJ_JOINT, joint.name), 1, 0}});
      for (const auto& [name, j] : urdf->joints_) {
        if (j->mimic && j->mimic->joint_name == joint.name) {
          followers_.back().push_back(
              {id(mjOBJ_JOINT, name), j->mimic->multiplier, j->mimic->offset});
        }
      }
    }
  }

  // The configuration x of `model`, joints moving at dq, the base at rest, everything else at zero.
  void set(const RobotModel& model, const double* x, const double* dq) {
    const int base = model.base_dof();
    mju_zero(data_->qpos, model_->nq);
    mju_zero(data_->qvel, model_->nv);
    const double yaw = base > 0 ? x[2] : 0;
    data_->qpos[0] = base > 0 ? x[0] : 0;
    data_->qpos[1] = base > 0 ? x[1] : 0;
    data_->qpos[3] = std::cos(yaw / 2);
    data_->qpos[6] = std::sin(yaw / 2);
    for (std::size_t i = 0; i < followers_.size(); ++i) {
      for (const Follower& f : followers_[i]) {
        data_->qpos[model_->jnt_qposadr[f.joint]] = f.multiplier * x[base + i] + f.offset;
        data_->qvel[dof(f)] = f.multiplier * dq[i];
      }
    }
    mj_forward(model_.get(), data_.get());
  }

  double mass() const { return mj_getTotalmass(model_.get()); }

  Eigen::Isometry3d X_WF(const std::string& link) const {
    const int body = id(mjOBJ_BODY, link);
    Eigen::Isometry3d X_WF = Eigen::Isometry3d::Identity();
    X_WF.translation() = Eigen::Map<const Eigen::Vector3d>(data_->xpos + 3 * body);
    X_WF.linear() =
        Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(data_->xmat + 9 * body);
    return X_WF;
  }

  // Columns as in RobotModel: base x, y, yaw (if it moves), joints.
  Eigen::MatrixXd frame_jacobian(const RobotModel& model, const std::string& link) const {
    using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Rows linear(3, model_->nv), angular(3, model_->nv);
    mj_jacBody(model_.get(), data_.get(), linear.data(), angular.data(), id(mjOBJ_BODY, link));
    Eigen::MatrixXd full(6, model_->nv), J(6, model.nx());
    full << linear, angular;
    if (model.base_dof() > 0) J.leftCols(3) << full.col(0), full.col(1), full.col(5);
    J.rightCols(model.joints()) = full * coupling();
    return J;
  }

  Eigen::MatrixXd mass_matrix() const {
    Eigen::MatrixXd full(model_->nv, model_->nv);
    mj_fullM(model_.get(), full.data(), data_->qM);
    return coupling().transpose() * full * coupling();
  }

  // c(q, dq) + g(q).
  Eigen::VectorXd bias() const {
    return coupling().transpose() * Eigen::Map<const Eigen::VectorXd>(data_->qfrc_bias, model_->nv);
  }

  // A contact between two links of the robot that robot.yaml does not exclude, or an empty text.
  std::string contact() const {
    for (int c = 0; c < data_->ncon; ++c) {
      if (data_->contact[c].dist > 0) continue;
      const std::string a = link_of(data_->contact[c].geom1), b = link_of(data_->contact[c].geom2);
      bool excluded = false;
      for (const auto& pair : config_.contact_excluded) {
        excluded |= (pair[0] == a && pair[1] == b) || (pair[0] == b && pair[1] == a);
      }
      if (!excluded) return a + " touches " + b;
    }
    return "";
  }

 private:
  struct Delete {
    void operator()(mjModel* m) const { mj_deleteModel(m); }
    void operator()(mjData* d) const { mj_deleteData(d); }
  };
  int id(int kind, const std::string& name) const {
    const int out = mj_name2id(model_.get(), kind, name.c_str());
    if (out < 0) throw std::runtime_error("MuJoCo has no " + name);
    return out;
  }
  // MuJoCo's own principal axes are good to 1e-8 only (mju_eig3 stops early); these are good to
  // rounding.
  void set_inertias() {
    const urdf::ModelInterfaceSharedPtr urdf = read_urdf(config_.urdf);
    for (const auto& [name, link] : urdf->links_) {
      if (!link->inertial) continue;
      const urdf::Inertial& in = *link->inertial;
      Eigen::Matrix3d I;
      I << in.ixx, in.ixy, in.ixz, in.ixy, in.iyy, in.iyz, in.ixz, in.iyz, in.izz;
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(I);
      Eigen::Matrix3d axes = to_eigen(in.origin).linear() * solver.eigenvectors();
      if (axes.determinant() < 0) axes.col(2) *= -1;
      const Eigen::Quaterniond q(axes);
      const int body = id(mjOBJ_BODY, name);
      model_->body_sameframe[body] = 0;  // its own axes may have been the body's, these are not
      Eigen::Map<Eigen::Vector3d>(model_->body_inertia + 3 * body) = solver.eigenvalues();
      Eigen::Map<Eigen::Vector4d>(model_->body_iquat + 4 * body) << q.w(), q.x(), q.y(), q.z();
    }
  }
  struct Follower {  // a joint of MuJoCo's that one of the model's moves
    int joint;
    double multiplier, offset;
  };
  int dof(const Follower& f) const { return model_->jnt_dofadr[f.joint]; }
  // MuJoCo's velocities for the model's joint velocities.
  Eigen::MatrixXd coupling() const {
    Eigen::MatrixXd G = Eigen::MatrixXd::Zero(model_->nv, followers_.size());
    for (std::size_t i = 0; i < followers_.size(); ++i) {
      for (const Follower& f : followers_[i]) G(dof(f), i) = f.multiplier;
    }
    return G;
  }
  std::string link_of(int geom) const {
    return mj_id2name(model_.get(), mjOBJ_BODY, model_->geom_bodyid[geom]);
  }

  RobotConfig config_;
  std::unique_ptr<mjModel, Delete> model_;
  std::unique_ptr<mjData, Delete> data_;
  std::vector<std::vector<Follower>> followers_;  // of each joint of the model; itself first
};

}  // namespace wb::test
