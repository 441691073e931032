// The simulated robot's joints as CiA 402 drives on CAN buses between processes: one hub for each
// bus and one node for each drive of the daemon's CAN plugin section, with its ids, scales and
// identities. Job world, one thread.
#pragma once
#include <memory>
#include <vector>

#include "drivers/can/node/cia402_node.hpp"
#include "drivers/can/plugin_config.hpp"
#include "drivers/can/socket_bus.hpp"
#include "drivers/plant/simulated_robot.hpp"

namespace wb::plant {

class CanSide {
 public:
  // Throws std::runtime_error (a joint that the robot lacks, a socket that cannot be made).
  CanSide(SimulatedRobot& robot, const can::PluginConfig& config);
  ~CanSide();

  bool paced() const { return buses_.front()->paced(); }
  // Paced: waits at most timeout_ms for the masters' tick, and runs buses and robot to its end.
  void serve(int timeout_ms);
  // Real time: brings buses and robot to this instant (CLOCK_MONOTONIC).
  void run_to(TimeNs monotonic_ns, TimeNs plant_ns);
  int drives_enabled() const;

 private:
  class Joint;
  SimulatedRobot& robot_;
  std::vector<std::unique_ptr<can::SocketBus>> buses_;
  std::vector<std::unique_ptr<Joint>> joints_;
  std::vector<std::unique_ptr<can::Cia402Node>> nodes_;
};

}  // namespace wb::plant
