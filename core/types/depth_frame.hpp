// One exposure of a depth camera, as perception and mapping receive it. Pixels live in a slot
// allocated at start. Depth is z-depth in metres, float32, row-major, optical frame (z forward, x
// right, y down), no return = +inf.
#pragma once
#include <cstdint>
#include <vector>

#include "core/types/name.hpp"
#include "core/types/time.hpp"

namespace wb {

struct CameraIntrinsics {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0,
         cy = 0;  // pixels; the centre of pixel (u, v) is (u + 0.5, v + 0.5)
  double range_min_m = 0.1, range_max_m = 8.0;
};

struct DepthFrame {
  std::uint64_t seq = 0;
  TimeNs t_ns = 0;  // exposure
  int camera = -1;  // index in robot.yaml's list of cameras
  CameraIntrinsics intrinsics;
  std::vector<float> depth;          // width * height
  std::vector<std::uint8_t> colour;  // width * height * 3 (RGB), or empty
};

}  // namespace wb
