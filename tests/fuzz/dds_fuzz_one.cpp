#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <vector>

#include "drivers/dds/frames.hpp"
#include "drivers/dds/low_level/command_filter.hpp"
#include "drivers/dds/samples.hpp"
#include "drivers/dds/truth.hpp"
#include "tests/drivers/dds/fake_robot.hpp"
#include "tests/fuzz/dds_fuzz.hpp"

namespace wb::dds {
namespace {

constexpr TimeNs kNow = 1'700'000'000 * kNanosPerSecond;
constexpr Arrival kArrival{kNow, 50'000'000};

void promise(bool kept) {
  if (!kept) std::abort();
}

// Values from the input, zeros after its end.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  template <class T>
  T take() {
    T value{};
    take(&value, sizeof value);
    return value;
  }
  bool flag() { return take<std::uint8_t>() & 1; }
  void take(void* to, std::size_t n) {
    const std::size_t have = std::min(n, size_);
    if (have > 0) std::memcpy(to, data_, have);
    data_ += have;
    size_ -= have;
  }
  std::size_t left() const { return size_; }
  const std::uint8_t* rest() const { return data_; }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
};

// Message that is good but for the bytes that the input flips.
template <class Message>
void flip(Message& message, Bytes& bytes) {
  auto* raw = reinterpret_cast<std::uint8_t*>(&message);
  for (int n = bytes.take<std::uint8_t>() % 8; n > 0; --n) {
    const std::size_t at = bytes.take<std::uint16_t>() % sizeof message;
    raw[at] ^= bytes.take<std::uint8_t>();
  }
}
// A bool may hold nothing but 0 and 1 here; Cyclone's deserialiser sees to it on the wire.
void to_bool(bool& b) {
  std::uint8_t raw;
  std::memcpy(&raw, &b, 1);
  b = raw & 1;
}

bool measurement(Bytes& bytes) {
  msg::JointMeasurements m{};
  m.boot_ = 7;
  m.sequence_ = 1;
  m.stamp_ns_ = kNow;
  m.joint_count_ = 5;
  std::fill_n(m.valid_, 5, true);
  m.imu_valid_ = m.wrench_valid_ = m.gripper_valid_ = true;
  flip(m, bytes);
  for (bool* b :
       {&m.imu_valid_, &m.wrench_valid_, &m.gripper_valid_, &m.emergency_stop_, &m.stopped_})
    to_bool(*b);
  for (bool& b : m.valid_) to_bool(b);
  MeasurementGate gate;
  gate.expect(7, 5, {4, 1, 0}, 0);
  Sample sample;
  if (gate.convert(m, kArrival, sample) != Fault::kNone) return false;
  promise(std::abs(sample.stamp_ns - kNow) <= 50'000'000);
  for (int i = 0; i < 3; ++i) {
    const auto& j = sample.readings.joints[i];
    promise(std::isfinite(j.position) && std::isfinite(j.velocity) && std::isfinite(j.effort));
    promise(j.age_ns >= 0 && j.status <= WB_JOINT_LOST && j.quality > 0 && j.quality <= 1);
  }
  for (const double v : sample.readings.imu.gyro) promise(std::isfinite(v));
  for (const double v : sample.readings.wrench.torque) promise(std::isfinite(v));
  promise(std::isfinite(sample.readings.gripper.opening));
  promise(gate.convert(m, kArrival, sample) == Fault::kDuplicate);
  return true;
}

bool command(Bytes& bytes) {
  const wb_description robot = fake_description();
  msg::JointCommands c{};
  c.stamp_ns_ = kNow;
  c.valid_for_ns_ = 50'000'000;
  c.joint_count_ = 5;
  std::fill_n(c.kind_, 5, std::uint8_t{WB_CMD_VELOCITY});
  flip(c, bytes);
  to_bool(c.has_gripper_);
  to_bool(c.stop_);
  if (refuse(c, robot, kNow, 100'000'000) != nullptr) return false;
  wb_commands out;
  clip(c, robot, out);
  for (std::uint32_t i = 0; i < robot.joint_count; ++i) {
    const auto& j = out.joints[i];
    const wb_joint_info& limits = robot.joints[i];
    promise(j.kind == WB_CMD_NONE || limits.command_kinds & (1u << j.kind));
    promise(std::abs(j.velocity) <= limits.velocity_max && std::abs(j.effort) <= limits.effort_max);
    promise(limits.is_wheel || std::abs(j.position) <= 2);
    promise(j.stiffness >= 0 && j.damping >= 0 && std::isfinite(j.stiffness + j.damping));
  }
  return true;
}

const CameraModel kCamera{8, 6, 10, 10, 4, 3};

bool good_depth(const std::vector<float>& depth) {
  return std::all_of(depth.begin(), depth.end(), [](float z) { return z > 0; });
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
  if (convert(m, kCamera, depth.data()) != Fault::kNone) return false;
  promise(good_depth(depth));
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
  if (convert(m, kCamera, depth.data()) != Fault::kNone) return false;
  promise(good_depth(depth));
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
  promise(model.pixels() > 0 && model.fx > 0 && std::isfinite(model.fx + model.fy + model.cx));
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
  promise(std::abs(sample.stamp_ns - kNow) <= 50'000'000 && std::isfinite(sample.gyro[0]));
  return true;
}

bool truth(Bytes& bytes) {
  static TruthStore store;  // its buffers are large
  store.expect(7);
  msg::Truth m{};
  m.boot_ = 7;
  m.sequence_ = 1;
  std::array<msg::TruthObject, 3> objects{};
  flip(objects, bytes);
  for (auto& o : objects) {
    to_bool(o.is_revolute_);
    o.name_[sizeof o.name_ - 1] = '\0';  // as Cyclone's deserialiser leaves it
  }
  view(m.objects_, objects, objects.size());
  m.contact_count_ = bytes.take<std::uint32_t>();
  if (store.store(m) != Fault::kNone) return false;
  const TruthSample& s = store.newest();
  for (std::uint32_t i = 0; i < s.object_count; ++i)
    promise(std::isfinite(s.objects[i].object.value + s.objects[i].object.X_SG.p[0]));
  return true;
}

}  // namespace

bool fuzz_one(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  constexpr bool (*kKinds[])(Bytes&) = {measurement, command, image, cloud,
                                        camera_info, imu,     truth};
  return kKinds[bytes.take<std::uint8_t>() % std::size(kKinds)](bytes);
}

}  // namespace wb::dds
