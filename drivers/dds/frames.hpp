// Checks and converts camera messages: hostile Image, PointCloud2 and CameraInfo in, z-depth in
// metres out. Pure; no DDS calls, no allocation: what a fuzzer drives. No return = +inf. Pixels:
// the centre of pixel (u, v) is (u + 0.5, v + 0.5) here, (u, v) in ROS.
#pragma once
#include <string>

#include "drivers/dds/samples.hpp"

namespace wb::dds {

struct CameraModel {
  std::uint32_t width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  std::size_t pixels() const { return std::size_t{width} * height; }
};

inline constexpr std::uint32_t kImageSideMax = 8192;

// Of the rectified image (P) where there is one, else of an image without distortion (K).
Fault read_camera_info(const msg::CameraInfo& in, CameraModel& out) noexcept;
// True if depth made for one means the same in the other.
bool same(const CameraModel& a, const CameraModel& b) noexcept;

// 32FC1 [m] or 16UC1 [mm]. depth: camera.pixels() values; overwritten also on failure.
Fault convert(const msg::Image& in, const CameraModel& camera, float* depth) noexcept;
// Points in the optical frame: organised like the camera, or any number of them in one row, which
// are projected (the nearest one wins).
Fault convert(const msg::PointCloud2& in, const CameraModel& camera, float* depth) noexcept;

}  // namespace wb::dds
