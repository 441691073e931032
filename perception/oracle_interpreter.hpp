// Scene interpreter that reads the simulator's truth and adds the errors of DEFINITIONS.md: a
// coarse prior of the object's pose, and at the pre-grasp a measurement relative to the shoulder
// camera while the handle is in its view. Errors are drawn once per run. Perception job. Frames: S
// simulated world, W odometry, C shoulder camera, G handle.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>

#include "core/model/robot_model.hpp"
#include "perception/scene_interpreter.hpp"

namespace wb {

// The truth about one object, in S.
struct ObjectTruth {
  ArticulationEstimate articulation;
  Eigen::Isometry3d X_SG;
  double handle_radius_m = 0, handle_length_m = 0;
  std::array<MaskBox, kMaxMasks> masks;  // carcass, moving part
  Eigen::Isometry3d X_SC;                // shoulder camera
};

struct OracleOptions {
  double prior_m = 0.05, prior_rad = 3.0 * M_PI / 180;  // one sigma
  double measured_m = 0.005, measured_rad = 0.5 * M_PI / 180;
  std::uint64_t seed = 0;
};

class OracleInterpreter : public SceneInterpreter {
 public:
  // truth: false if there is no such object. X_SW: where the odometry frame (the base at its start)
  // lies in the simulated world.
  using TruthSource = std::function<bool(const Name& object, ObjectTruth& truth)>;
  OracleInterpreter(std::shared_ptr<const RobotModel> model, const OracleOptions& options,
                    TruthSource truth, const Eigen::Isometry3d& X_SW);

  bool interpret(const Name& object, const RobotState& state, ObjectPlan& plan) override;

 private:
  bool in_view(const Eigen::Isometry3d& X_CG) const;

  std::shared_ptr<const RobotModel> model_;
  TruthSource truth_;
  Eigen::Isometry3d X_SW_;
  CameraIntrinsics camera_;
  int camera_frame_ = 0;
  Eigen::Vector3d prior_translation_, measured_translation_;
  double prior_yaw_, measured_yaw_;
};

}  // namespace wb
