#include "drivers/dds/frames.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string_view>

namespace wb::dds {
namespace {

constexpr float kNoReturn = std::numeric_limits<float>::infinity();

float z_depth(float z) noexcept { return std::isfinite(z) && z > 0 ? z : kNoReturn; }

template <class T>
T load(const std::uint8_t* from) noexcept {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

std::string_view view_of(const char* text) noexcept { return text ? text : ""; }

// Bytes from a point's start to the float32 of that name; negative if there is none.
std::int64_t offset_of(const msg::PointCloud2& in, std::string_view name) noexcept {
  for (std::uint32_t i = 0; i < in.fields_._length; ++i) {
    const msg::PointField& field = in.fields_._buffer[i];
    if (view_of(field.name_) != name) continue;
    constexpr int kFloat32 = 7;
    if (field.datatype_ != kFloat32 || field.count_ > 1) return -1;
    if (std::uint64_t{field.offset_} + sizeof(float) > in.point_step_) return -1;
    return field.offset_;
  }
  return -1;
}

}  // namespace

Fault read_camera_info(const msg::CameraInfo& in, CameraModel& out) noexcept {
  if (in.width_ == 0 || in.height_ == 0 || in.width_ > kImageSideMax || in.height_ > kImageSideMax)
    return Fault::kWrongSize;
  const bool rectified = in.p_[0] > 0;
  for (std::uint32_t i = 0; !rectified && i < in.d_._length; ++i) {
    if (in.d_._buffer[i] != 0) return Fault::kUncalibrated;
  }
  const CameraModel model{in.width_,
                          in.height_,
                          rectified ? in.p_[0] : in.k_[0],
                          rectified ? in.p_[5] : in.k_[4],
                          (rectified ? in.p_[2] : in.k_[2]) + 0.5,
                          (rectified ? in.p_[6] : in.k_[5]) + 0.5};
  for (const double value : {model.fx, model.fy, model.cx, model.cy}) {
    if (!std::isfinite(value)) return Fault::kNonFinite;
  }
  if (model.fx <= 0 || model.fy <= 0) return Fault::kUncalibrated;
  out = model;
  return Fault::kNone;
}

bool same(const CameraModel& a, const CameraModel& b) noexcept {
  constexpr double kPixels = 0.01;
  return a.width == b.width && a.height == b.height && std::abs(a.fx - b.fx) < kPixels &&
         std::abs(a.fy - b.fy) < kPixels && std::abs(a.cx - b.cx) < kPixels &&
         std::abs(a.cy - b.cy) < kPixels;
}

Fault convert(const msg::Image& in, const CameraModel& camera, float* depth) noexcept {
  const std::string_view encoding = view_of(in.encoding_);
  const bool metres = encoding == "32FC1";
  if ((!metres && encoding != "16UC1") || in.is_bigendian_ != 0) return Fault::kEncoding;
  if (in.width_ != camera.width || in.height_ != camera.height) return Fault::kWrongSize;
  const std::uint64_t size = metres ? sizeof(float) : sizeof(std::uint16_t);
  if (in.step_ < size * in.width_ || std::uint64_t{in.step_} * in.height_ != in.data_._length)
    return Fault::kWrongSize;
  for (std::uint32_t v = 0; v < in.height_; ++v) {
    const std::uint8_t* row = in.data_._buffer + std::size_t{v} * in.step_;
    for (std::uint32_t u = 0; u < in.width_; ++u) {
      *depth++ = z_depth(metres ? load<float>(row + u * size)
                                : static_cast<float>(1e-3 * load<std::uint16_t>(row + u * size)));
    }
  }
  return Fault::kNone;
}

Fault convert(const msg::PointCloud2& in, const CameraModel& camera, float* depth) noexcept {
  if (in.is_bigendian_) return Fault::kEncoding;
  const std::int64_t x = offset_of(in, "x"), y = offset_of(in, "y"), z = offset_of(in, "z");
  if (x < 0 || y < 0 || z < 0) return Fault::kEncoding;
  const bool organised = in.height_ > 1;
  if (organised && (in.width_ != camera.width || in.height_ != camera.height))
    return Fault::kWrongSize;
  if (in.height_ == 0 || std::uint64_t{in.width_} * in.point_step_ > in.row_step_ ||
      std::uint64_t{in.row_step_} * in.height_ != in.data_._length)
    return Fault::kWrongSize;
  if (organised) {
    for (std::uint32_t v = 0; v < in.height_; ++v) {
      const std::uint8_t* row = in.data_._buffer + std::size_t{v} * in.row_step_;
      for (std::uint32_t u = 0; u < in.width_; ++u)
        *depth++ = z_depth(load<float>(row + std::size_t{u} * in.point_step_ + z));
    }
    return Fault::kNone;
  }
  std::fill_n(depth, camera.pixels(), kNoReturn);
  for (std::uint32_t i = 0; i < in.width_; ++i) {
    const std::uint8_t* point = in.data_._buffer + std::size_t{i} * in.point_step_;
    const float pz = z_depth(load<float>(point + z));
    if (pz == kNoReturn) continue;
    const double u = camera.fx * load<float>(point + x) / pz + camera.cx;
    const double v = camera.fy * load<float>(point + y) / pz + camera.cy;
    if (!(u >= 0 && u < camera.width && v >= 0 && v < camera.height)) continue;
    float& pixel = depth[static_cast<std::size_t>(v) * camera.width + static_cast<std::size_t>(u)];
    pixel = std::min(pixel, pz);
  }
  return Fault::kNone;
}

}  // namespace wb::dds
