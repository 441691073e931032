#include "drivers/plant/gripper_side.hpp"

#include <cmath>

namespace wb::plant {

GripperSide::GripperSide(SimulatedRobot& robot, const std::filesystem::path& port,
                         double opening_max_m)
    : robot_(robot),
      fingers_{robot.readings().gripper.opening, false},
      gripper_(port, {opening_max_m, 0, 255}, [this](const robotiq::FingerOrder& order, double) {
        const std::lock_guard lock(mutex_);
        order_ = order;
        return fingers_;
      }) {}

void GripperSide::exchange() {
  constexpr double kThere_m = 0.001;
  const wb_readings r = robot_.readings();
  const std::lock_guard lock(mutex_);
  fingers_.opening_m = r.gripper.opening;
  // It stands still while it presses with most of what it was told to.
  fingers_.blocked = order_.move && std::abs(r.gripper.opening - order_.opening_m) > kThere_m &&
                     std::abs(r.gripper.force) > 0.8 * order_.force_n;
  if (order_.move) robot_.grip(order_.opening_m, order_.force_n);
}

}  // namespace wb::plant
