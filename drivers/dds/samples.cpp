#include "drivers/dds/samples.hpp"

#include <algorithm>
#include <cmath>

namespace wb::dds {
namespace {

// Keeps sums and differences of stamps from overflowing: the year 2116 of ROS time.
constexpr TimeNs kStampMax = TimeNs{1} << 62;

bool finite(const double* values, int count) noexcept {
  return std::all_of(values, values + count, [](double v) { return std::isfinite(v); });
}

Fault age_fault(TimeNs stamp_ns, const Arrival& arrival) noexcept {
  if (stamp_ns > arrival.now_ns + kSampleFutureNs) return Fault::kFuture;
  if (arrival.memory_ns > 0 && stamp_ns < arrival.now_ns - arrival.memory_ns) return Fault::kStale;
  return Fault::kNone;
}

}  // namespace

Fault StampGate::check(TimeNs stamp_ns, const Arrival& arrival) noexcept {
  if (stamp_ns < 0 || stamp_ns > kStampMax) return Fault::kMalformed;
  if (const Fault fault = age_fault(stamp_ns, arrival); fault != Fault::kNone) return fault;
  if (stamp_ns == newest_ns_) return Fault::kDuplicate;
  if (stamp_ns < newest_ns_) return Fault::kOutOfOrder;
  newest_ns_ = stamp_ns;
  return Fault::kNone;
}

double Quality::add(std::uint64_t sequence, TimeNs stamp_ns) noexcept {
  const TimeNs part = stamp_ns / kPartNs;
  // Parts of the second that passed without a measurement hold nothing any more.
  for (TimeNs p = std::max(part_ + 1, part - kParts + 1); p <= part; ++p)
    due_[p % kParts] = came_[p % kParts] = 0;
  part_ = std::max(part_, part);
  due_[part % kParts] += newest_ == 0 ? 1 : sequence - newest_;
  came_[part % kParts] += 1;
  newest_ = sequence;
  double due = 0, came = 0;
  for (int p = 0; p < kParts; ++p) {
    due += static_cast<double>(due_[p]);
    came += static_cast<double>(came_[p]);
  }
  return came / due;
}

void MeasurementGate::expect(std::uint64_t boot, std::uint32_t joint_count,
                             std::vector<std::uint32_t> joints, std::uint64_t session) {
  boot_ = boot;
  session_ = session;
  joint_count_ = joint_count;
  joints_ = std::move(joints);
  sequence_ = 0;
  newest_ns_ = -1;
  quality_ = {};
}

Fault MeasurementGate::convert(const msg::JointMeasurements& in, const Arrival& arrival,
                               Sample& out) noexcept {
  if (in.boot_ != boot_ || in.session_ != session_) return Fault::kWrongSource;
  if (in.joint_count_ != joint_count_) return Fault::kWrongSize;
  if (in.stamp_ns_ < 0 || in.stamp_ns_ > kStampMax) return Fault::kMalformed;
  if (in.sequence_ == sequence_) return Fault::kDuplicate;
  if (in.sequence_ < sequence_) return Fault::kOutOfOrder;
  if (const Fault fault = age_fault(in.stamp_ns_, arrival); fault != Fault::kNone) return fault;
  // A paced robot may be asked twice at one time.
  if (in.stamp_ns_ < newest_ns_ || (in.stamp_ns_ == newest_ns_ && session_ == 0))
    return Fault::kFrozen;
  for (const std::uint32_t j : joints_) {
    if (in.status_[j] > WB_JOINT_LOST || in.age_ns_[j] < 0 || in.age_ns_[j] > kStampMax)
      return Fault::kMalformed;
    if (in.valid_[j] && !(std::isfinite(in.position_[j]) && std::isfinite(in.velocity_[j]) &&
                          std::isfinite(in.effort_[j])))
      return Fault::kNonFinite;
  }
  if ((in.imu_valid_ && !(finite(in.gyro_, 3) && finite(in.acceleration_, 3))) ||
      (in.wrench_valid_ && !(finite(in.force_, 3) && finite(in.torque_, 3))) ||
      (in.gripper_valid_ &&
       !(std::isfinite(in.gripper_opening_) && std::isfinite(in.gripper_force_))))
    return Fault::kNonFinite;

  sequence_ = in.sequence_;
  newest_ns_ = in.stamp_ns_;
  const double quality = quality_.add(sequence_, newest_ns_);
  out.stamp_ns = in.stamp_ns_;
  out.lease = in.lease_;
  out.tick = in.tick_;
  out.stopped = in.stopped_;
  wb_readings& r = out.readings;
  r = {};
  for (std::size_t i = 0; i < joints_.size(); ++i) {
    const std::uint32_t j = joints_[i];
    auto& joint = r.joints[i];
    joint.quality = quality;
    joint.status = in.status_[j];
    joint.error_code = in.error_[j];
    if (!in.valid_[j]) continue;
    joint.position = in.position_[j];
    joint.velocity = in.velocity_[j];
    joint.effort = in.effort_[j];
    joint.age_ns = in.age_ns_[j];
    joint.valid = 1;
  }
  if (in.imu_valid_) {
    std::copy_n(in.gyro_, 3, r.imu.gyro);
    std::copy_n(in.acceleration_, 3, r.imu.acceleration);
    r.imu.valid = 1;
  }
  if (in.wrench_valid_) {
    std::copy_n(in.force_, 3, r.wrench.force);
    std::copy_n(in.torque_, 3, r.wrench.torque);
    r.wrench.valid = 1;
  }
  if (in.gripper_valid_) r.gripper = {in.gripper_opening_, in.gripper_force_, 1};
  r.emergency_stop = in.emergency_stop_;
  return Fault::kNone;
}

Fault convert(const msg::Imu& in, const Arrival& arrival, StampGate& gate,
              ImuSample& out) noexcept {
  const auto& w = in.angular_velocity_;
  const auto& a = in.linear_acceleration_;
  const double values[6] = {w.x_, w.y_, w.z_, a.x_, a.y_, a.z_};
  if (!finite(values, 6)) return Fault::kNonFinite;
  const TimeNs stamp = from_message(in.header_.stamp_);
  if (const Fault fault = gate.check(stamp, arrival); fault != Fault::kNone) return fault;
  out.stamp_ns = stamp;
  std::copy_n(values, 3, out.gyro);
  std::copy_n(values + 3, 3, out.acceleration);
  return Fault::kNone;
}

Fault convert(const msg::WrenchStamped& in, const Arrival& arrival, StampGate& gate,
              WrenchSample& out) noexcept {
  const auto& f = in.wrench_.force_;
  const auto& t = in.wrench_.torque_;
  const double values[6] = {f.x_, f.y_, f.z_, t.x_, t.y_, t.z_};
  if (!finite(values, 6)) return Fault::kNonFinite;
  const TimeNs stamp = from_message(in.header_.stamp_);
  if (const Fault fault = gate.check(stamp, arrival); fault != Fault::kNone) return fault;
  out.stamp_ns = stamp;
  std::copy_n(values, 3, out.force);
  std::copy_n(values + 3, 3, out.torque);
  return Fault::kNone;
}

}  // namespace wb::dds
