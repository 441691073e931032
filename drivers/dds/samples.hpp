// Checks and converts samples of joints, IMU and wrench: hostile messages in, the driver ABI's
// types out. Pure; no DDS calls, no allocation: what a fuzzer drives. Stamps: ROS time, or virtual
// time of a paced robot.
#pragma once
#include <vector>

#include "drivers/dds/counters.hpp"
#include "drivers/dds/messages.hpp"
#include "drivers/driver.h"

namespace wb::dds {

inline constexpr TimeNs kSampleFutureNs = 5'000'000;  // no stamp may be further ahead

// When a sample arrives, on the stamps' clock.
struct Arrival {
  TimeNs now_ns = 0;
  TimeNs memory_ns = 0;  // older samples are stale; 0: any age
};

// Order and age of one stream of stamped samples.
class StampGate {
 public:
  Fault check(TimeNs stamp_ns, const Arrival& arrival) noexcept;

 private:
  TimeNs newest_ns_ = -1;
};

// One measurement as the ports hand it on; ages and validity are settled when it is read.
struct Sample {
  std::uint64_t seq = 0;  // Latest's
  TimeNs stamp_ns = 0;
  wb_readings readings{};  // joints in the plugin's order, age_ns as of the stamp
  std::uint64_t lease = 0;
  std::uint64_t tick = 0;
  bool stopped = false;
};
struct ImuSample {
  std::uint64_t seq = 0;
  TimeNs stamp_ns = 0;
  double gyro[3] = {}, acceleration[3] = {};
};
struct WrenchSample {
  std::uint64_t seq = 0;
  TimeNs stamp_ns = 0;
  double force[3] = {}, torque[3] = {};
};

// Share of the measurements of the last second that came in time, from their sequence numbers.
class Quality {
 public:
  double add(std::uint64_t sequence, TimeNs stamp_ns) noexcept;

 private:
  static constexpr int kParts = 10;
  static constexpr TimeNs kPartNs = kNanosPerSecond / kParts;
  std::uint64_t newest_ = 0;
  TimeNs part_ = -1;  // stamp / kPartNs
  std::uint64_t due_[kParts] = {}, came_[kParts] = {};
};

// The stream of JointMeasurements of one low-level computer.
class MeasurementGate {
 public:
  // joint_count: the low-level computer's; joints: its index of each of the plugin's; session: 0 if
  // the robot is not paced.
  void expect(std::uint64_t boot, std::uint32_t joint_count, std::vector<std::uint32_t> joints,
              std::uint64_t session);
  Fault convert(const msg::JointMeasurements& in, const Arrival& arrival, Sample& out) noexcept;

 private:
  std::uint64_t boot_ = 0, session_ = 0, sequence_ = 0;
  std::uint32_t joint_count_ = 0;
  std::vector<std::uint32_t> joints_;
  TimeNs newest_ns_ = -1;
  Quality quality_;
};

Fault convert(const msg::Imu& in, const Arrival& arrival, StampGate& gate, ImuSample& out) noexcept;
Fault convert(const msg::WrenchStamped& in, const Arrival& arrival, StampGate& gate,
              WrenchSample& out) noexcept;

}  // namespace wb::dds
