// The messages, topics and QoS of the daemon's service over idl/dds.hpp. World: jobs only. Included
// by this folder's sources and its tests, by no other room.
#pragma once
#include "builtin_interfaces/msg/Time.h"
#include "diagnostic_msgs/msg/DiagnosticArray.h"
#include "idl/dds.hpp"
#include "nav_msgs/msg/Odometry.h"
#include "nav_msgs/msg/Path.h"
#include "sensor_msgs/msg/JointState.h"
#include "std_msgs/msg/Float64.h"
#include "tf2_msgs/msg/TFMessage.h"
#include "wholebody_msgs/msg/Command.h"
#include "wholebody_msgs/msg/CommandAck.h"
#include "wholebody_msgs/msg/Explanation.h"
#include "wholebody_msgs/msg/Status.h"
#include "wholebody_msgs/msg/Tuning.h"

namespace wb::dds {

namespace msg {
using Time = builtin_interfaces_msg_dds__Time_;
using Header = std_msgs_msg_dds__Header_;
using DiagnosticStatus = diagnostic_msgs_msg_dds__DiagnosticStatus_;
using KeyValue = diagnostic_msgs_msg_dds__KeyValue_;
using PoseStamped = geometry_msgs_msg_dds__PoseStamped_;
using RosPose = geometry_msgs_msg_dds__Pose_;
using TransformStamped = geometry_msgs_msg_dds__TransformStamped_;
using LoopTiming = wholebody_msgs_msg_dds__LoopTiming_;
using Counter = wholebody_msgs_msg_dds__Counter_;
using TermPull = wholebody_msgs_msg_dds__TermPull_;
using Competition = wholebody_msgs_msg_dds__Competition_;
using Weight = wholebody_msgs_msg_dds__Weight_;
}  // namespace msg

WB_DDS_TOPIC_TYPE(diagnostic_msgs, DiagnosticArray)
WB_DDS_TOPIC_TYPE(nav_msgs, Odometry)
WB_DDS_TOPIC_TYPE(nav_msgs, Path)
WB_DDS_TOPIC_TYPE(sensor_msgs, JointState)
WB_DDS_TOPIC_TYPE(std_msgs, Float64)
WB_DDS_TOPIC_TYPE(tf2_msgs, TFMessage)
WB_DDS_TOPIC_TYPE(wholebody_msgs, Command)
WB_DDS_TOPIC_TYPE(wholebody_msgs, CommandAck)
WB_DDS_TOPIC_TYPE(wholebody_msgs, Explanation)
WB_DDS_TOPIC_TYPE(wholebody_msgs, Status)
WB_DDS_TOPIC_TYPE(wholebody_msgs, Tuning)

inline constexpr char kCommandTopic[] = "rt/wholebody/command";
inline constexpr char kAckTopic[] = "rt/wholebody/acknowledgement";
inline constexpr char kStatusTopic[] = "rt/wholebody/status";
inline constexpr char kExplanationTopic[] = "rt/wholebody/explanation";
inline constexpr char kTuningTopic[] = "rt/wholebody/tuning";

inline constexpr Profile kCommandProfile{true, false, 10};
// Deep enough that the outcome of one request is not pushed out by the refusals of another
// client's.
inline constexpr Profile kAckProfile{true, true, 32};
inline constexpr Profile kStreamProfile{true, false, 1};
inline constexpr Profile kLatchedProfile{true, true, 1};

}  // namespace wb::dds
