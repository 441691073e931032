#include "mpc/terms/body_twist.hpp"

#include <cmath>

namespace wb {

void body_twist(const RobotModel& model, int frame, const RobotModel::Data& data,
                const StateVector& x, const InputVector& u, bool state_derivative,
                BodyTwist& out) noexcept {
  const int base_dof = model.base_dof(), base_inputs = model.base_inputs();
  Jacobian J;
  model.frame_jacobian(frame, data, J);
  out.V_u.resize(6, model.nu());
  if (base_inputs > 0) {
    const Eigen::Vector3d forward(std::cos(x[2]), std::sin(x[2]), 0);
    out.V_u.col(0) << forward, Eigen::Vector3d::Zero();
    if (base_inputs == 3) out.V_u.col(1) << -forward.y(), forward.x(), 0, 0, 0, 0;
    out.V_u.col(base_inputs - 1) = J.col(2);
  }
  out.V_u.rightCols(model.joints()) = J.rightCols(model.joints());
  out.V.noalias() = out.V_u.lazyProduct(u);
  if (!state_derivative) return;

  out.V_x.setZero(6, model.nx());
  // A turn of the base turns the whole motion with it.
  const Eigen::Vector3d z = Eigen::Vector3d::UnitZ();
  if (base_dof > 0) out.V_x.col(2) << z.cross(out.V.head<3>()), z.cross(out.V.tail<3>());
  // From the frame towards the base: a joint turns the velocities of all that lies beyond it, and
  // moves the frame's origin in the rotation of all that lies before it.
  const double* rates = u.data() + base_inputs;
  const Eigen::Vector3d p_W = model.X_WF(frame, data).translation();
  Eigen::Vector3d beyond = Eigen::Vector3d::Zero(), beyond_angular = Eigen::Vector3d::Zero();
  for (int body = model.frame_body(frame); body > 0; body = model.parent(body)) {
    const int joint = model.joint_of(body), c = base_dof + joint;
    const Eigen::Vector3d axis = model.ratio(body) * data.axis_W[body];
    const Eigen::Vector3d lever =
        model.prismatic(body) ? axis : axis.cross(p_W - data.X_WL[body].translation());
    beyond += lever * rates[joint];
    if (!model.prismatic(body)) beyond_angular += axis * rates[joint];
    const Eigen::Vector3d before_angular = out.V.tail<3>() - beyond_angular;
    out.V_x.col(c).head<3>() += before_angular.cross(lever);
    if (model.prismatic(body)) continue;
    out.V_x.col(c).head<3>() += axis.cross(beyond);
    out.V_x.col(c).tail<3>() += axis.cross(beyond_angular);
  }
}

}  // namespace wb
