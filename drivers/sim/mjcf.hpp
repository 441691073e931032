// MuJoCo's model of robot and scene, generated: every URDF link becomes a body with its own
// inertial and collision solids, the scene's units bodies without joints, and their moving parts
// bodies with one joint. Setup world. Names: bodies after links, units and parts; joints after URDF
// joints and parts; geoms after collisions and solids.
#pragma once
#include <mujoco/mujoco.h>

#include <memory>
#include <string>

#include "drivers/sim/sim_config.hpp"

namespace wb::sim {

inline constexpr const char* kFloorGeom = "floor";

// Contact bits. A pair may touch where one's type meets the other's affinity: furniture and floor
// with the robot, the robot with itself; wheels and castors with floor and furniture only.
namespace bits {
inline constexpr int kFurniture = 1, kRobot = 2, kFloor = 4;
}

// The robot stands at the origin of S, its joints at zero.
std::string to_mjcf(const PluginConfig& config);

struct ModelDeleter {
  void operator()(mjModel* m) const { mj_deleteModel(m); }
  void operator()(mjData* d) const { mj_deleteData(d); }
};
using ModelPtr = std::unique_ptr<mjModel, ModelDeleter>;
using DataPtr = std::unique_ptr<mjData, ModelDeleter>;

// Compiles the text. Throws config::ConfigError with MuJoCo's message.
ModelPtr compile(const std::string& mjcf);

}  // namespace wb::sim
