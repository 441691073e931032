#include "drivers/dds/low_level/robot_messages.hpp"

namespace wb::dds {

DescriptionMessage::DescriptionMessage(const wb_description& robot,
                                       std::span<const std::uint32_t> timeout_actions,
                                       std::span<const LowLevelCamera> cameras) {
  copy_text(message_.name_, robot.name);
  for (std::uint32_t i = 0; i < robot.joint_count; ++i) {
    const wb_joint_info& in = robot.joints[i];
    copy_text(joints_[i].name_, in.name);
    joints_[i].position_min_ = in.position_min;
    joints_[i].position_max_ = in.position_max;
    joints_[i].velocity_max_ = in.velocity_max;
    joints_[i].effort_max_ = in.effort_max;
    joints_[i].command_kinds_ = in.command_kinds;
    joints_[i].timeout_actions_ = timeout_actions[i];
    joints_[i].is_wheel_ = in.is_wheel != 0;
  }
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    copy_text(cameras_[i].name_, cameras[i].name);
    copy_text(cameras_[i].topic_, cameras[i].topic);
  }
  view(message_.joints_, joints_, robot.joint_count);
  view(message_.cameras_, cameras_, cameras.size());
  message_.has_imu_ = robot.has_imu != 0;
  message_.has_wrench_ = robot.has_wrench != 0;
  message_.has_gripper_ = robot.has_gripper != 0;
  message_.has_emergency_stop_ = robot.has_emergency_stop != 0;
}

msg::JointMeasurements measurement_message(const wb_readings& r, std::uint32_t joint_count) {
  msg::JointMeasurements out{};
  out.stamp_ns_ = r.t_ns;
  out.joint_count_ = joint_count;
  for (std::uint32_t i = 0; i < joint_count; ++i) {
    const auto& joint = r.joints[i];
    out.valid_[i] = joint.valid != 0;
    out.status_[i] = static_cast<std::uint8_t>(joint.status);
    out.error_[i] = joint.error_code;
    out.age_ns_[i] = joint.age_ns;
    out.position_[i] = joint.position;
    out.velocity_[i] = joint.velocity;
    out.effort_[i] = joint.effort;
  }
  out.imu_valid_ = r.imu.valid != 0;
  std::copy_n(r.imu.gyro, 3, out.gyro_);
  std::copy_n(r.imu.acceleration, 3, out.acceleration_);
  out.wrench_valid_ = r.wrench.valid != 0;
  std::copy_n(r.wrench.force, 3, out.force_);
  std::copy_n(r.wrench.torque, 3, out.torque_);
  out.gripper_valid_ = r.gripper.valid != 0;
  out.gripper_opening_ = r.gripper.opening;
  out.gripper_force_ = r.gripper.force;
  out.emergency_stop_ = r.emergency_stop != 0;
  return out;
}

msg::CameraInfo camera_info_message(const LowLevelCamera& c, TimeNs stamp_ns) {
  msg::CameraInfo out{};
  out.header_ = {to_message(stamp_ns), text(c.name.c_str())};
  out.width_ = static_cast<std::uint32_t>(c.width);
  out.height_ = static_cast<std::uint32_t>(c.height);
  out.distortion_model_ = text("plumb_bob");
  // ROS counts pixels from their centres.
  const double cx = c.cx - 0.5, cy = c.cy - 0.5;
  const double k[9] = {c.fx, 0, cx, 0, c.fy, cy, 0, 0, 1};
  const double p[12] = {c.fx, 0, cx, 0, 0, c.fy, cy, 0, 0, 0, 1, 0};
  std::copy_n(k, 9, out.k_);
  std::copy_n(p, 12, out.p_);
  out.r_[0] = out.r_[4] = out.r_[8] = 1;
  return out;
}

}  // namespace wb::dds
