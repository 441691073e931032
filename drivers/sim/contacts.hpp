// Which geoms touched the robot since the start: distinct pairs, in the order of their first touch.
// Step world. Left out: a finger on a handle, and a wheel or castor on the floor.
#pragma once
#include <mujoco/mujoco.h>

#include <array>
#include <vector>

#include "drivers/sim/sim_config.hpp"

namespace wb::sim {

struct Touch {
  TimeNs t_ns = 0;
  int robot_geom = 0, other_geom = 0;  // other_geom may be the robot's too
};

class ContactLog {
 public:
  ContactLog(const PluginConfig& config, const mjModel& model);

  void scan(const mjData& data, TimeNs t_ns) noexcept;
  const std::vector<Touch>& touches() const noexcept { return touches_; }
  bool is_robot(int geom) const noexcept { return kinds_[geom] & kRobot; }

 private:
  static constexpr int kMaxTouches = 1024;
  enum Kind : unsigned { kRobot = 1, kFinger = 2, kRolling = 4, kHandle = 8, kFloor = 16 };

  bool expected(unsigned a, unsigned b) const noexcept;

  std::vector<unsigned> kinds_;  // by geom
  std::vector<bool> seen_;       // by pair
  std::vector<Touch> touches_;
};

}  // namespace wb::sim
