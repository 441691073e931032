// Damped least squares for a robot's arm with its base at the origin, joint limits by clamping.
// Setup world; deterministic. Frame B, SI units. Source: Wampler 1986 (damped least squares).
#pragma once
#include <vector>

#include "core/model/robot_model.hpp"

namespace wb {

struct ArmRange {  // of each joint; of one without limits half a turn to either side
  std::vector<double> lower, upper;
};
ArmRange arm_range(const RobotModel& model);

struct IkResult {
  std::vector<double> q;
  double position_error_m = 0, angle_error_rad = 0;
};

IkResult solve_ik(const RobotModel& model, const ArmRange& range, const Eigen::Isometry3d& X_BE,
                  std::vector<double> q, int iterations = 80);

// All bodies' poses with the base at the origin.
RobotModel::Data arm_data(const RobotModel& model, const std::vector<double>& q);
// Smallest singular value of the hand's Jacobian, its translation divided by `length_m`.
double least_singular_value(const RobotModel& model, const std::vector<double>& q, double length_m);

// Signed distance between capsules: axes' distance less the radii.
double capsule_distance(const RobotModel::Data& data, const Capsule& a, const Capsule& b);
// Smallest among the model's pairs.
double pair_distance(const RobotModel& model, const RobotModel::Data& data);

}  // namespace wb
