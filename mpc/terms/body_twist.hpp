// The twist V_WF of a frame (linear over angular, about the frame's origin, in W) as a function of
// x and u, with both derivatives. Step world. The base's inputs are (v, w) or (vx, vy, w) in B.
// Source: Featherstone 2008, Rigid Body Dynamics Algorithms, Ch. 2 (derivatives of moving axes).
#pragma once
#include "core/model/robot_model.hpp"
#include "mpc/term.hpp"

namespace wb {

struct BodyTwist {
  using InputJacobian = Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::ColMajor, 6, kMaxInputs>;
  Eigen::Matrix<double, 6, 1> V;
  InputJacobian V_u;  // 6 x nu
  Jacobian V_x;       // 6 x nx; set only if asked for
};

void body_twist(const RobotModel& model, int frame, const RobotModel::Data& data,
                const StateVector& x, const InputVector& u, bool state_derivative,
                BodyTwist& out) noexcept;

}  // namespace wb
