// One input is a series of messages to the low-level computer (dds_session.cpp), or a sample each
// to the checks of the plugin: good ones but for the bytes that the input changes, partly through
// Cyclone's own serialiser.
// Promises, whatever is received: no crash, nothing undefined (sanitizers), and
//   no command reaches a drive but the lease holder's, in order, in time, finite, within the
//   joint's limits, with neither a stop nor an emergency stop before it; no value is taken as
//   measured that is not finite, too old, from the future, or seen before.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <vector>

#include "drivers/dds/frames.hpp"
#include "drivers/dds/samples.hpp"
#include "drivers/dds/truth.hpp"
#include "tests/fuzz/dds_session.hpp"
#include "tests/fuzz/dds_wire.hpp"

namespace wb::dds {
namespace {

constexpr TimeNs kNow = 1'700'000'000 * kNanosPerSecond;
constexpr Arrival kArrival{kNow, 50'000'000};

template <class Readings>
bool finite(const Readings& r, int joints) {
  for (int i = 0; i < joints; ++i) {
    const auto& j = r.joints[i];
    if (!std::isfinite(j.position + j.velocity + j.effort)) return false;
  }
  for (int i = 0; i < 3; ++i) {
    if (!std::isfinite(r.imu.gyro[i] + r.imu.acceleration[i])) return false;
    if (!std::isfinite(r.wrench.force[i] + r.wrench.torque[i])) return false;
  }
  return std::isfinite(r.gripper.opening) && std::isfinite(r.gripper.force);
}

// A stream of joint measurements, some of them late, doubled or out of order.
fuzz::Tally measurements(Bytes& bytes) {
  MeasurementGate gate;
  gate.expect(7, 5, {4, 1, 0}, 0);
  fuzz::Tally tally;
  std::uint64_t newest = 0;
  TimeNs newest_stamp = -1;
  Arrival arrival = kArrival;
  do {
    arrival.now_ns += 1'000'000;
    msg::JointMeasurements m{};
    m.boot_ = 7;
    m.sequence_ = newest + 1;
    m.stamp_ns_ = arrival.now_ns;
    if (bytes.flag()) m.sequence_ += bytes.take<std::int8_t>();
    if (bytes.flag()) m.stamp_ns_ += bytes.take<std::int16_t>() * 10'000;
    m.joint_count_ = 5;
    std::fill_n(m.valid_, 5, true);
    m.imu_valid_ = m.wrench_valid_ = m.gripper_valid_ = true;
    const Wired<msg::JointMeasurements> wired(m, bytes);
    ++tally.records;
    if (!wired.taken()) continue;
    const msg::JointMeasurements& got = wired.message();
    Sample sample;
    if (gate.convert(got, arrival, sample) != Fault::kNone) continue;
    ++tally.taken;
    promise(got.sequence_ > newest && sample.stamp_ns > newest_stamp,
            "taken twice or out of order");
    promise(sample.stamp_ns >= arrival.now_ns - arrival.memory_ns, "a stale sample");
    promise(sample.stamp_ns <= arrival.now_ns + kSampleFutureNs, "a sample from the future");
    promise(finite(sample.readings, 3), "a measurement that is not finite");
    for (int i = 0; i < 3; ++i) {
      const auto& j = sample.readings.joints[i];
      promise(j.age_ns >= 0 && j.status <= WB_JOINT_LOST, "an age or status that cannot be");
      promise(j.quality > 0 && j.quality <= 1, "a quality that is no share");
    }
    newest = got.sequence_;
    newest_stamp = sample.stamp_ns;
    promise(gate.convert(got, arrival, sample) == Fault::kDuplicate, "a sample taken twice");
  } while (bytes.left() > 0);
  return tally;
}

const CameraModel kCamera{8, 6, 10, 10, 4, 3};

bool good_depth(const std::vector<float>& depth) {
  return std::all_of(depth.begin(), depth.end(), [](float z) { return z > 0; });
}

// As it is, or through the wire.
template <class Message>
bool convert_one(const Message& m, Bytes& bytes, float* depth) {
  if (bytes.flag()) return convert(m, kCamera, depth) == Fault::kNone;
  const Wired<Message> wired(m, bytes);
  return wired.taken() && convert(wired.message(), kCamera, depth) == Fault::kNone;
}

// The message's pixels or points, exactly as long as its
// allocation, so that a sanitizer sees the first byte beyond.
std::unique_ptr<std::uint8_t[]> payload(Bytes& bytes, std::uint32_t size) {
  auto data = std::make_unique<std::uint8_t[]>(size);
  if (bytes.left() > 0) {
    for (std::uint32_t i = 0; i < size; ++i) data[i] = bytes.rest()[i % bytes.left()];
  }
  return data;
}

bool image(Bytes& bytes) {
  msg::Image m{};
  const bool metres = bytes.flag();
  std::uint32_t size = 48 * (metres ? 4 : 2);
  m.encoding_ = text(metres ? "32FC1" : "16UC1");
  m.width_ = 8;
  m.height_ = 6;
  m.step_ = size / 6;
  if (bytes.flag()) m.width_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) m.height_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) m.step_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) m.is_bigendian_ = bytes.take<std::uint8_t>();
  if (bytes.flag()) size += bytes.take<std::uint8_t>() - 64;
  const auto data = payload(bytes, size);
  m.data_ = {size, size, data.get(), false};
  std::vector<float> depth(kCamera.pixels());
  if (!convert_one(m, bytes, depth.data())) return false;
  promise(good_depth(depth), "a depth behind the camera");
  return true;
}

bool cloud(Bytes& bytes) {
  msg::PointCloud2 m{};
  const bool organised = bytes.flag();
  const std::uint32_t step = 12 + bytes.take<std::uint8_t>() % 8;
  std::uint32_t size = 48 * step;
  m.width_ = organised ? 8 : 48;
  m.height_ = organised ? 6 : 1;
  m.point_step_ = step;
  m.row_step_ = m.width_ * step;
  std::array<msg::PointField, 3> fields{};
  const char* names[] = {"x", "y", "z"};
  for (int i = 0; i < 3; ++i) {
    fields[i].name_ = text(names[i]);
    fields[i].offset_ = bytes.take<std::uint8_t>() % (step - 3);
    fields[i].datatype_ = 7;
    fields[i].count_ = 1;
  }
  if (bytes.flag()) fields[bytes.take<std::uint8_t>() % 3].offset_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) fields[1].datatype_ = bytes.take<std::uint8_t>();
  if (bytes.flag()) m.width_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) m.height_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) m.point_step_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) m.row_step_ = bytes.take<std::uint32_t>();
  if (bytes.flag()) size += bytes.take<std::uint8_t>() - 64;
  view(m.fields_, fields, fields.size());
  const auto data = payload(bytes, size);
  m.data_ = {size, size, data.get(), false};
  std::vector<float> depth(kCamera.pixels());
  if (!convert_one(m, bytes, depth.data())) return false;
  promise(good_depth(depth), "a depth behind the camera");
  return true;
}

bool camera_info(Bytes& bytes) {
  msg::CameraInfo m{};
  m.width_ = 8;
  m.height_ = 6;
  m.k_[0] = m.k_[4] = 10;
  bytes.take(m.k_, sizeof m.k_);
  if (bytes.flag()) bytes.take(m.p_, sizeof m.p_);
  if (bytes.flag()) m.width_ = bytes.take<std::uint32_t>();
  CameraModel model;
  if (read_camera_info(m, model) != Fault::kNone) return false;
  promise(model.pixels() > 0 && model.fx > 0 && model.fy > 0 &&
              std::isfinite(model.fx + model.fy + model.cx + model.cy),
          "a camera model without sense");
  return true;
}

bool imu(Bytes& bytes) {
  msg::Imu m{};
  m.header_.stamp_ = to_message(kNow);
  if (bytes.flag()) bytes.take(&m.header_.stamp_, sizeof m.header_.stamp_);
  if (bytes.flag()) bytes.take(&m.angular_velocity_, sizeof m.angular_velocity_);
  StampGate gate;
  ImuSample sample;
  if (convert(m, kArrival, gate, sample) != Fault::kNone) return false;
  promise(std::abs(sample.stamp_ns - kNow) <= kArrival.memory_ns, "a stale sample");
  for (int i = 0; i < 3; ++i)
    promise(std::isfinite(sample.gyro[i] + sample.acceleration[i]), "a rate that is not finite");
  return true;
}

bool truth(Bytes& bytes) {
  static TruthStore store;  // its buffers are large
  store.expect(7);
  msg::Truth m{};
  m.boot_ = 7;
  m.sequence_ = 1;
  std::array<msg::TruthObject, 3> objects{};
  for (auto& o : objects) {
    std::strcpy(o.name_, "drawer");
    bytes.take(&o.value_, sizeof o.value_);
  }
  view(m.objects_, objects, objects.size());
  m.contact_count_ = bytes.take<std::uint32_t>();
  const Wired<msg::Truth> wired(m, bytes);
  if (!wired.taken() || store.store(wired.message()) != Fault::kNone) return false;
  const TruthSample& t = store.newest();
  for (std::uint32_t i = 0; i < t.object_count; ++i)
    promise(std::isfinite(t.objects[i].object.value + t.objects[i].object.X_SG.p[0]),
            "a truth that is not finite");
  return true;
}

template <bool (*sample)(Bytes&)>
fuzz::Tally series(Bytes& bytes) {
  fuzz::Tally tally;
  do {
    tally.taken += sample(bytes);
    ++tally.records;
  } while (bytes.left() > 0);
  return tally;
}

}  // namespace
}  // namespace wb::dds

namespace wb::fuzz {

const char* const kName = "dds";
const char* const kRecords = "samples";
const char* const kTaken = "taken, each as promised";

Tally run_one(const std::uint8_t* data, std::size_t size) {
  using namespace dds;
  Bytes bytes(data, size);
  constexpr Tally (*kKinds[])(Bytes&) = {session,       measurements,        series<image>,
                                         series<cloud>, series<camera_info>, series<imu>,
                                         series<truth>};
  return kKinds[bytes.take<std::uint8_t>() % std::size(kKinds)](bytes);
}

std::vector<std::uint8_t> seeded(std::mt19937_64& random) {
  std::vector<std::uint8_t> input(random() % 4 ? 1 + random() % 96 : 1 + random() % 1024);
  // Sparse bytes keep most fields as a good message has them.
  const bool sparse = random() % 2 == 0;
  for (std::uint8_t& b : input)
    b = sparse && random() % 8 != 0 ? 0 : static_cast<std::uint8_t>(random());
  input[0] = static_cast<std::uint8_t>(random());
  return input;
}

}  // namespace wb::fuzz
