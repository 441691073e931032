// What four mecanum wheels do to the floor. MuJoCo's wheels are smooth: they carry the load and
// slide; this adds the force of the rollers under each, along the roller's axis, which is where a
// roller does not roll: in proportion to the wheel's slip there, at most friction times load. Step
// world. Source: Muir and Neuman 1987; why not rollers of geometry: docs/how-to/add-a-robot.md.
#pragma once
#include <mujoco/mujoco.h>

#include <vector>

#include "drivers/sim/sim_config.hpp"

namespace wb::sim {

class Rollers {
 public:
  // No wheels, no rollers: for other bases than omnidirectional ones everything here does nothing.
  Rollers(const PluginConfig& config, const mjModel& model);

  // The wheels' loads: call between the step's integration and the next position stage, while
  // MuJoCo's forces still belong to its positions.
  void take_loads(const mjModel& model, const mjData& data) noexcept;
  // Sets data.qfrc_applied for the next physics step from the state now.
  void apply(const mjModel& model, mjData& data) const noexcept;

 private:
  struct Wheel {
    int body = 0, geom = 0;
    double sideways = 0;  // the roller's axis in the base: (1, sideways) / sqrt 2
    double load_n = 0;
  };
  std::vector<Wheel> wheels_;
  int base_body_ = 0;
  double radius_m_ = 0, slip_nspm_ = 0, friction_ = 0;
};

}  // namespace wb::sim
