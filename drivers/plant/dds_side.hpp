// The simulated robot behind drivers/dds' low-level protocol: everything (commands, sensors,
// cameras, truth), or all but the joints where those are drives on a CAN bus. Job world, one
// thread.
#pragma once
#include <string>

#include "drivers/dds/low_level/low_level.hpp"
#include "drivers/plant/simulated_robot.hpp"

namespace wb::plant {

struct DdsOptions {
  std::string prefix = "robot";
  int domain = 0;
  bool paced = false;
  bool joints = true;    // commanded over DDS
  bool gripper = true;   // commanded over DDS
  bool advances = true;  // paced: DDS ticks move the plant; false: somebody else does
  bool truth = true;
};

class DdsSide final : private dds::LowLevelRobot {
 public:
  DdsSide(SimulatedRobot& robot, const DdsOptions& options);

  // Serves the protocol for at most timeout_ns.
  void spin(TimeNs timeout_ns) { low_level_.spin(timeout_ns); }
  // Not paced: sends truth and frames that are due; call after the plant has moved.
  void publish();
  std::uint64_t ticks() const { return low_level_.counts().ticks; }
  std::uint64_t time_outs() const { return low_level_.counts().time_outs; }

 private:
  void read(wb_readings& readings) override;
  void apply(const wb_commands& commands) override;
  void stop(const wb_timeout_action* actions) override;
  bool advance(TimeNs t) override;

  void publish(TimeNs clock_less_plant_ns);
  void publish_truth(TimeNs t_ns);
  static wb_description described(const SimulatedRobot& robot, const DdsOptions& options);
  static dds::LowLevelOptions low_level(const SimulatedRobot& robot, const DdsOptions& options);

  SimulatedRobot& robot_;
  DdsOptions options_;
  TimeNs clock_less_plant_ns_ = 0;  // the protocol's clock, paced
  TimeNs next_truth_ns_ = 0;        // plant's time
  std::vector<std::string> links_;
  dds::LowLevel::Truth truth_;
  dds::LowLevel low_level_;
};

}  // namespace wb::plant
