// The low-level side's messages, made from the driver ABI's types. World: job.
#pragma once
#include <array>
#include <span>

#include "drivers/dds/low_level/low_level.hpp"
#include "drivers/dds/messages.hpp"

namespace wb::dds {

// Refers to storage of its own.
class DescriptionMessage {
 public:
  DescriptionMessage(const wb_description& robot, std::span<const std::uint32_t> timeout_actions,
                     std::span<const LowLevelCamera> cameras);
  DescriptionMessage(const DescriptionMessage&) = delete;
  DescriptionMessage& operator=(const DescriptionMessage&) = delete;
  msg::RobotDescription& get() { return message_; }

 private:
  msg::RobotDescription message_{};
  std::array<msg::JointInfo, WB_DRIVER_MAX_JOINTS> joints_{};
  std::array<msg::CameraName, 8> cameras_{};
};

// What the robot measures; the rest is zero. The stamp is the robot's.
msg::JointMeasurements measurement_message(const wb_readings& readings, std::uint32_t joint_count);

// Refers to the camera's name.
msg::CameraInfo camera_info_message(const LowLevelCamera& camera, TimeNs stamp_ns);

}  // namespace wb::dds
