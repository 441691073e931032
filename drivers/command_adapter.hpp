// How one joint of the robot is commanded through its plugin: the controller's impedance command as
// it is, as a position set-point with feed-forward, or as the effort that the impedance comes to;
// wheels by velocity only. Constructor: setup world. adapt: control thread, pure. rad or m, Nm or
// N.
#pragma once
#include <string>

#include "core/rt/rt_safe.hpp"
#include "core/types/command.hpp"
#include "core/types/readings.hpp"
#include "drivers/driver.h"

namespace wb {

class CommandAdapter {
 public:
  CommandAdapter() = default;
  // The way of commanding joint `info`; wanted: WB_CMD_NONE, or one that must be used. Throws
  // std::runtime_error (config::ConfigError if `wanted` is what it does not support) naming the
  // joint, the kinds it supports and those that would do.
  CommandAdapter(const wb_joint_info& info, bool wheel, wb_command_kind wanted);

  wb_command_kind kind() const { return kind_; }

  // `reading`: the joint's newest. Torque is refused (WB_CMD_NONE) without a valid one.
  void adapt(const JointCommand& in, const JointReading& reading, wb_commands& commands,
             int joint) const RT_SAFE;

 private:
  wb_command_kind kind_ = WB_CMD_NONE;
  double effort_max_ = 0;
};

// "impedance" and so on; nullptr for a number that is no kind.
const char* to_string(wb_command_kind kind);

}  // namespace wb
