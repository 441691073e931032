// The simulated robot's gripper behind a simulated Robotiq 2F-85 on a pseudo-terminal. The gripper
// serves its line on a thread of its own; exchange() is the plant's thread.
#pragma once
#include <filesystem>
#include <mutex>

#include "drivers/plant/simulated_robot.hpp"
#include "drivers/robotiq/simulated_gripper.hpp"

namespace wb::plant {

class GripperSide {
 public:
  GripperSide(SimulatedRobot& robot, const std::filesystem::path& port, double opening_max_m);
  // Hands the newest order to the plant and its fingers to the gripper.
  void exchange();

 private:
  SimulatedRobot& robot_;
  std::mutex mutex_;
  robotiq::FingerOrder order_;
  robotiq::Fingers fingers_;
  robotiq::SimulatedGripper gripper_;
};

}  // namespace wb::plant
