// The messages, topics and QoS between this plugin and a robot's low-level computer. World: the DDS
// threads of the plugin and of the low-level side. Topics: docs/how-to/dds.md.
#pragma once
#include "builtin_interfaces/msg/Time.h"
#include "core/types/time.hpp"
#include "geometry_msgs/msg/WrenchStamped.h"
#include "idl/dds.hpp"
#include "sensor_msgs/msg/CameraInfo.h"
#include "sensor_msgs/msg/Image.h"
#include "sensor_msgs/msg/Imu.h"
#include "sensor_msgs/msg/PointCloud2.h"
#include "wholebody_msgs/msg/JointCommands.h"
#include "wholebody_msgs/msg/JointMeasurements.h"
#include "wholebody_msgs/msg/LeaseGrant.h"
#include "wholebody_msgs/msg/LeaseRequest.h"
#include "wholebody_msgs/msg/RobotDescription.h"
#include "wholebody_msgs/msg/Tick.h"
#include "wholebody_msgs/msg/Truth.h"

namespace wb::dds {

namespace msg {
using Time = builtin_interfaces_msg_dds__Time_;
using PointField = sensor_msgs_msg_dds__PointField_;
using JointInfo = wholebody_msgs_msg_dds__JointInfo_;
using CameraName = wholebody_msgs_msg_dds__CameraName_;
using TruthPose = wholebody_msgs_msg_dds__TruthPose_;
using TruthBox = wholebody_msgs_msg_dds__TruthBox_;
using TruthObject = wholebody_msgs_msg_dds__TruthObject_;
using TruthContact = wholebody_msgs_msg_dds__TruthContact_;
using TruthLink = wholebody_msgs_msg_dds__TruthLink_;
}  // namespace msg

WB_DDS_TOPIC_TYPE(geometry_msgs, WrenchStamped)
WB_DDS_TOPIC_TYPE(sensor_msgs, CameraInfo)
WB_DDS_TOPIC_TYPE(sensor_msgs, Image)
WB_DDS_TOPIC_TYPE(sensor_msgs, Imu)
WB_DDS_TOPIC_TYPE(sensor_msgs, PointCloud2)
WB_DDS_TOPIC_TYPE(wholebody_msgs, JointCommands)
WB_DDS_TOPIC_TYPE(wholebody_msgs, JointMeasurements)
WB_DDS_TOPIC_TYPE(wholebody_msgs, LeaseGrant)
WB_DDS_TOPIC_TYPE(wholebody_msgs, LeaseRequest)
WB_DDS_TOPIC_TYPE(wholebody_msgs, RobotDescription)
WB_DDS_TOPIC_TYPE(wholebody_msgs, Tick)
WB_DDS_TOPIC_TYPE(wholebody_msgs, Truth)

// DDS name of one of the low-level computer's topics.
inline std::string robot_topic(const std::string& prefix, const char* name) {
  return "rt/" + prefix + "/" + name;
}

// Writers keep the newest only, so that a lost sample is never resent in a newer one's place.
inline constexpr Profile kNewest{true, false, 1};
inline constexpr Profile kLatched{true, true, 1};
inline constexpr Profile kEvents{true, false, 16};        // lease; and readers of a paced robot
inline constexpr Profile kStreamReader{false, false, 8};  // best effort: nothing waits for a resend
inline constexpr Profile kFrameWriter{true, false, 4};

// A stamp as ROS puts it into headers.
inline msg::Time to_message(TimeNs t) {
  const TimeNs s = t / kNanosPerSecond;
  return {static_cast<std::int32_t>(s), static_cast<std::uint32_t>(t - s * kNanosPerSecond)};
}
// Negative if it is none.
inline TimeNs from_message(const msg::Time& t) {
  if (t.sec_ < 0 || t.nanosec_ >= kNanosPerSecond) return -1;
  return t.sec_ * kNanosPerSecond + t.nanosec_;
}

}  // namespace wb::dds
