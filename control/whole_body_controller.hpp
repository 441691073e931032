// Turns the MPC's policy into servo set-points. Control loop, step world. Arm: integrates the
// policy's joint velocities onto the set-points, adds gravity torque; while an object is held, an
// admittance yields to wrenches across the path so that errors of the estimated joint axis do not
// build up force (no section `admittance`: none). Base: wheel velocities. Frames: W, B, E. SI.
// Source: Mittal et al. 2022, Sec. IV (policy evaluation); Siciliano et al. 2009, Sec. 9.2
// (admittance).
#pragma once
#include <memory>

#include "core/config/config.hpp"
#include "core/model/robot_model.hpp"
#include "core/model/wheel_kinematics.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/command.hpp"
#include "core/types/policy.hpp"
#include "core/types/robot_state.hpp"

namespace wb {

struct WholeBodyInput {
  const RobotState* state = nullptr;          // q_command: where the set-points stand
  const Policy* policy = nullptr;             // null: stand still
  double rate_scale = 1.0;                    // of the policy's rates: keeps their direction
  bool held = false;                          // an object is in the hand
  Eigen::Vector3d free_direction_W{0, 0, 0};  // unit: the way the object moves (held only)
  GripperCommand gripper;
  double dt_s = 0;
};

class WholeBodyController {
 public:
  WholeBodyController(std::shared_ptr<const RobotModel> model, const config::Section& section);

  void step(const WholeBodyInput& in, Command& out) RT_SAFE;

 private:
  void add_admittance(const WholeBodyInput& in, JointVector& dq) RT_SAFE;

  std::shared_ptr<const RobotModel> model_;
  WheelKinematics kinematics_;
  std::vector<double> stiffness_, damping_;
  bool admits_ = false;                                    // has a wrist sensor to yield by
  double translation_damping_ = 0, rotation_damping_ = 0;  // Ns/m, Nms/rad
  double translation_max_ = 0, rotation_max_ = 0;          // m/s, rad/s
  double least_singular_ = 0;                              // damping of the pseudo-inverse
};

}  // namespace wb
