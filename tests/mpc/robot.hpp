// What the MPC's tests share: Mabi-Mobile, its poses, random states, and references and fields made
// by hand.
#pragma once
#include <cmath>
#include <memory>
#include <random>

#include "core/model/robot_model.hpp"
#include "mpc/slq_solver.hpp"

namespace wb::mpc_test {

inline RobotConfig mabi_config() {
  return RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile");
}

inline std::shared_ptr<const RobotModel> mabi() {
  static const auto model = std::make_shared<const RobotModel>(mabi_config());
  return model;
}

inline StateVector state_at(const RobotModel& model, const std::array<double, 3>& base,
                            const std::vector<double>& q) {
  StateVector x(model.nx());
  for (int i = 0; i < model.base_dof(); ++i) x[i] = base[i];
  for (int j = 0; j < model.joints(); ++j) x[model.base_dof() + j] = q[j];
  return x;
}

inline Eigen::Isometry3d end_effector_pose(const RobotModel& model, const StateVector& x) {
  RobotModel::Data data;
  model.forward_kinematics(x.data(), data);
  return model.X_WF(model.end_effector(), data);
}

inline Pose pose(double x, double y, double z, double qx, double qy, double qz, double qw) {
  return Pose::from({x, y, z}, Eigen::Quaterniond(qw, qx, qy, qz).normalized());
}

// The four goals of the reference problem (facts/mpc.md), of the frame WRIST_2.
inline std::array<Pose, 4> reference_goals() {
  return {pose(-0.5, -0.8, 0.6, 0.33, 0, 0, 0.95), pose(0.4, -0.6, 0.9, 0, 0.33, 0, 0.95),
          pose(0.6, 0.5, 0.5, 0, 0, 0.33, 0.95), pose(-0.3, 0.5, 0.8, -0.33, 0, 0, 0.95)};
}

inline Reference reach_for(const Pose& goal) {
  Reference reference;
  reference.ee[0].count = 1;
  reference.ee[0].keyframes[0].X_WE = goal;
  return reference;
}

struct Box {
  Eigen::Vector3d low, high;
};

// Signed distance to boxes, sampled at voxel centres, 120 x 120 x 40 voxels of 0.1 m about the
// origin.
inline DistanceField field_of(const std::vector<Box>& boxes) {
  DistanceField field({120, 120, 40}, 0.1);
  field.seq = 1;
  field.origin_W = {-6.0, -6.0, -0.5};
  for (int k = 0; k < 40; ++k) {
    for (int j = 0; j < 120; ++j) {
      for (int i = 0; i < 120; ++i) {
        const Eigen::Vector3d p = field.origin_W + 0.1 * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5);
        double nearest = DistanceField::kNoMap;
        for (const Box& box : boxes) {
          const Eigen::Vector3d outside = (box.low - p).cwiseMax(p - box.high);
          const double distance =
              outside.maxCoeff() > 0 ? outside.cwiseMax(0.0).norm() : outside.maxCoeff();
          nearest = std::min(nearest, distance);
        }
        field.at(i, j, k) = static_cast<float>(nearest);
      }
    }
  }
  return field;
}

}  // namespace wb::mpc_test
