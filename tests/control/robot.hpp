// What the control tests share: Mabi-Mobile, its control.yaml, and the pose of its hand.
#pragma once
#include <memory>

#include "core/config/config.hpp"
#include "core/model/robot_model.hpp"
#include "core/types/robot_state.hpp"

namespace wb::control_test {

inline constexpr double kDt = 0.0025;  // s, the control loop's period
inline constexpr TimeNs kPeriodNs = 2'500'000;

inline std::shared_ptr<const RobotModel> mabi() {
  static const auto model = std::make_shared<const RobotModel>(
      RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile"));
  return model;
}

inline config::Section control_section(const std::string& key) {
  return config::Section::open(mabi()->config().folder / "control.yaml").section(key);
}

inline StateVector state_vector(const std::array<double, 3>& base, const double* q) {
  StateVector x(mabi()->nx());
  x << base[0], base[1], base[2], Eigen::Map<const Eigen::VectorXd>(q, mabi()->joints());
  return x;
}

inline Eigen::Isometry3d hand_pose(const std::array<double, 3>& base, const double* q) {
  RobotModel::Data data;
  mabi()->forward_kinematics(state_vector(base, q).data(), data);
  return mabi()->X_WF(mabi()->end_effector(), data);
}

inline RobotState standing_state(const std::vector<double>& q) {
  RobotState s;
  s.joint_count = mabi()->joints();
  std::copy(q.begin(), q.end(), s.q.begin());
  s.q_command = s.q;
  return s;
}

}  // namespace wb::control_test
