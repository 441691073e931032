// The robot that wb-plant puts behind a bus: the simulator's plugin (physics, sensors, cameras,
// truth) with its servos driven joint by joint, and no time-out but that of who drives them. Job
// world, one thread. Time: the plant's own, from 0. Joints: the description's, the arm then wheels.
#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "drivers/driver.h"
#include "drivers/sim/instance.hpp"
#include "drivers/sim/truth.h"

namespace wb::plant {

// What a joint's drive makes of it, whoever commands the drive.
struct JointTarget {
  enum class Kind { kBrake, kPosition, kVelocity, kTorque, kImpedance };
  Kind kind = Kind::kBrake;
  double position = 0, velocity = 0, torque = 0;  // impedance: all three, with the gains
  double stiffness = 0, damping = 0;
};

class SimulatedRobot {
 public:
  // config: a section as the sim plugin has it. Throws std::runtime_error.
  SimulatedRobot(const std::string& config, const std::filesystem::path& folder);
  ~SimulatedRobot();

  const wb_description& description() const { return description_; }
  int joint(const std::string& name) const;  // -1: there is none
  TimeNs now() const { return driver_->now_ns(); }

  void set(int joint, const JointTarget& target) { targets_[joint] = target; }
  const JointTarget& target(int joint) const { return targets_[joint]; }
  void grip(double opening_m, double force_n);
  // Runs the physics to t. Throws std::runtime_error if it has become unstable.
  void advance(TimeNs t);

  // As the sensors say it, with ages as of now.
  wb_readings readings() const;
  double position(int joint) const;  // without noise, rad
  double velocity(int joint) const;
  bool next_frame(wb_frame& frame);  // release() each
  void release(const wb_frame& frame);

  wb_driver* driver() const { return driver_; }
  const wb_sim_truth& truth() const { return *truth_; }

 private:
  void write();

  const wb_driver_api* api_;
  wb_driver* driver_ = nullptr;
  const wb_sim_truth* truth_ = nullptr;
  wb_description description_{};
  std::vector<JointTarget> targets_;
  std::vector<double> last_position_;  // of position targets, NaN: none before
  wb_commands commands_{};
};

}  // namespace wb::plant
