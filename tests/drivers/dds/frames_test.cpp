// Camera messages of each encoding, and what is wrong with bad ones, without DDS.
#include "drivers/dds/frames.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "drivers/dds/frame_ring.hpp"

namespace wb::dds {
namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr CameraModel kCamera{4, 3, 10, 10, 2, 1.5};

struct Cloud {
  std::vector<std::uint8_t> data;
  std::array<msg::PointField, 4> fields{};
  msg::PointCloud2 message{};

  // Points of `step` bytes with x, y, z at these offsets, rows padded by `padding` bytes.
  Cloud(std::uint32_t width, std::uint32_t height, std::uint32_t step,
        std::array<std::uint32_t, 3> offsets, std::uint32_t padding = 0)
      : data(std::size_t{height} * (width * step + padding), 0xee) {
    const char* names[] = {"intensity", "z", "x", "y"};
    const std::uint32_t at[] = {0, offsets[2], offsets[0], offsets[1]};
    for (int i = 0; i < 4; ++i) {
      fields[i].name_ = text(names[i]);
      fields[i].offset_ = at[i];
      fields[i].datatype_ = i == 0 ? 2 : 7;
      fields[i].count_ = 1;
    }
    view(message.fields_, fields, fields.size());
    view(message.data_, data, data.size());
    message.width_ = width;
    message.height_ = height;
    message.point_step_ = step;
    message.row_step_ = width * step + padding;
  }
  void put(std::uint32_t u, std::uint32_t v, float x, float y, float z) {
    std::uint8_t* point = data.data() + v * message.row_step_ + u * message.point_step_;
    std::memcpy(point + fields[2].offset_, &x, 4);
    std::memcpy(point + fields[3].offset_, &y, 4);
    std::memcpy(point + fields[1].offset_, &z, 4);
  }
};

struct Picture {
  std::vector<std::uint8_t> data;
  msg::Image message{};
  Picture(const char* encoding, std::uint32_t size, std::uint32_t padding = 0) {
    message.encoding_ = text(encoding);
    message.width_ = kCamera.width;
    message.height_ = kCamera.height;
    message.step_ = kCamera.width * size + padding;
    data.resize(message.step_ * message.height_, 0xee);
    view(message.data_, data, data.size());
  }
  template <class T>
  void put(std::uint32_t u, std::uint32_t v, T value) {
    std::memcpy(data.data() + v * message.step_ + u * sizeof value, &value, sizeof value);
  }
};

TEST(DepthImage, In32FC1IsMetres) {
  Picture p("32FC1", 4, 8);
  for (std::uint32_t v = 0; v < 3; ++v) {
    for (std::uint32_t u = 0; u < 4; ++u) p.put(u, v, 1.0f + v + 0.1f * u);
  }
  p.put(1, 0, std::numeric_limits<float>::quiet_NaN());
  p.put(2, 0, 0.0f);
  p.put(3, 0, -2.0f);
  std::vector<float> depth(12);
  ASSERT_EQ(convert(p.message, kCamera, depth.data()), Fault::kNone);
  EXPECT_EQ(depth[0], 1.0f);
  EXPECT_EQ(depth[1], kInf);
  EXPECT_EQ(depth[2], kInf);
  EXPECT_EQ(depth[3], kInf);
  EXPECT_EQ(depth[11], 3.3f);
}

TEST(DepthImage, In16UC1IsMillimetres) {
  Picture p("16UC1", 2, 2);
  for (std::uint32_t v = 0; v < 3; ++v) {
    for (std::uint32_t u = 0; u < 4; ++u) p.put(u, v, static_cast<std::uint16_t>(1000 * v + u));
  }
  std::vector<float> depth(12);
  ASSERT_EQ(convert(p.message, kCamera, depth.data()), Fault::kNone);
  EXPECT_EQ(depth[0], kInf) << "0: no return";
  EXPECT_FLOAT_EQ(depth[1], 0.001f);
  EXPECT_FLOAT_EQ(depth[11], 2.003f);
}

TEST(DepthImage, IsRefusedWhenItContradictsItself) {
  std::vector<float> depth(12);
  const auto fault = [&](auto&& change, const char* encoding = "32FC1") {
    Picture p(encoding, 4);
    change(p.message);
    return convert(p.message, kCamera, depth.data());
  };
  EXPECT_EQ(fault([](auto&) {}, "rgb8"), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& m) { m.encoding_ = nullptr; }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& m) { m.is_bigendian_ = 1; }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& m) { m.width_ = 5; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& m) { m.height_ = 0; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& m) { m.step_ = 15; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& m) { m.step_ = 0x80000000u; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& m) { m.data_._length -= 1; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto&) {}), Fault::kNone);
}

TEST(PointCloud, OrganisedIsDepthByPixel) {
  // x, y and z at odd offsets, in odd order.
  Cloud cloud(4, 3, 21, {13, 5, 1}, 3);
  for (std::uint32_t v = 0; v < 3; ++v) {
    for (std::uint32_t u = 0; u < 4; ++u) cloud.put(u, v, 9, 9, 1.0f + u + 10 * v);
  }
  cloud.put(0, 0, 0, 0, std::numeric_limits<float>::quiet_NaN());
  std::vector<float> depth(12);
  ASSERT_EQ(convert(cloud.message, kCamera, depth.data()), Fault::kNone);
  EXPECT_EQ(depth[0], kInf);
  EXPECT_EQ(depth[3], 4.0f);
  EXPECT_EQ(depth[6], 13.0f);
}

TEST(PointCloud, UnorganisedIsProjectedAndTheNearestPointWins) {
  Cloud cloud(6, 1, 16, {0, 4, 8});
  // Through the centre of pixel (1, 2): u = 1.5, v = 2.5.
  cloud.put(0, 0, -0.05f * 2, 0.1f * 2, 2);
  cloud.put(1, 0, -0.05f * 3, 0.1f * 3, 3);
  cloud.put(2, 0, 0, 0, -1);
  cloud.put(3, 0, 100, 0, 1);
  cloud.put(4, 0, std::numeric_limits<float>::quiet_NaN(), 0, 1);
  cloud.put(5, 0, 1e38f, 1e38f, 1e-38f);
  std::vector<float> depth(12, 7.0f);
  ASSERT_EQ(convert(cloud.message, kCamera, depth.data()), Fault::kNone);
  for (std::size_t i = 0; i < depth.size(); ++i) EXPECT_EQ(depth[i], i == 9 ? 2.0f : kInf) << i;
}

TEST(PointCloud, IsRefusedWhenItContradictsItself) {
  std::vector<float> depth(12);
  const auto fault = [&](auto&& change, std::uint32_t height = 3) {
    Cloud cloud(4, height, 16, {0, 4, 8});
    change(cloud);
    return convert(cloud.message, kCamera, depth.data());
  };
  EXPECT_EQ(fault([](auto& c) { c.message.is_bigendian_ = true; }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& c) { c.fields[1].datatype_ = 8; }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& c) { c.fields[1].offset_ = 13; }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& c) { c.fields[1].offset_ = UINT32_MAX; }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& c) { c.fields[2].name_ = text("q"); }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& c) { c.message.fields_._length = 2; }), Fault::kEncoding);
  EXPECT_EQ(fault([](auto& c) { c.message.width_ = 5; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& c) { c.message.row_step_ = 12; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& c) { c.message.data_._length -= 1; }), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& c) { c.message.width_ = UINT32_MAX; }, 1), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto& c) { c.message.height_ = 0; }, 1), Fault::kWrongSize);
  EXPECT_EQ(fault([](auto&) {}), Fault::kNone);
}

TEST(CameraInfo, CountsPixelsFromTheirCorners) {
  msg::CameraInfo info{};
  info.width_ = 4;
  info.height_ = 3;
  info.k_[0] = info.k_[4] = 10;
  info.k_[2] = 1.5;
  info.k_[5] = 1.0;
  CameraModel model;
  ASSERT_EQ(read_camera_info(info, model), Fault::kNone);
  EXPECT_TRUE(same(model, kCamera));
  // The rectified image's matrix goes before that of the raw one.
  info.p_[0] = info.p_[5] = 11;
  ASSERT_EQ(read_camera_info(info, model), Fault::kNone);
  EXPECT_EQ(model.fx, 11);
  EXPECT_EQ(model.cx, 0.5);
}

TEST(CameraInfo, IsRefusedWithoutCalibrationOrWithDistortion) {
  msg::CameraInfo info{};
  CameraModel model;
  EXPECT_EQ(read_camera_info(info, model), Fault::kWrongSize);
  info.width_ = 4;
  info.height_ = 3;
  EXPECT_EQ(read_camera_info(info, model), Fault::kUncalibrated);
  info.k_[0] = info.k_[4] = 10;
  std::array<double, 1> distortion{0.1};
  view(info.d_, distortion, 1);
  EXPECT_EQ(read_camera_info(info, model), Fault::kUncalibrated);
  distortion[0] = 0;
  info.k_[2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(read_camera_info(info, model), Fault::kNonFinite);
  info.k_[2] = 0;
  EXPECT_EQ(read_camera_info(info, model), Fault::kNone);
  info.width_ = 9000;
  EXPECT_EQ(read_camera_info(info, model), Fault::kWrongSize);
}

TEST(FrameRing, LendsTheOldestAndGivesUpTheOldestWhenFull) {
  FrameRing ring(1);
  bool lost = false;
  EXPECT_EQ(ring.acquire(), -1);
  for (int t = 1; t <= FrameRing::kSlots + 2; ++t) {
    float* depth = ring.begin(lost);
    ASSERT_NE(depth, nullptr);
    EXPECT_EQ(lost, t > FrameRing::kSlots);
    *depth = static_cast<float>(t);
    ring.end(t);
  }
  const int first = ring.acquire();
  EXPECT_EQ(ring.t_ns(first), 3);
  EXPECT_EQ(*ring.depth(first), 3.0f);
  EXPECT_EQ(ring.t_ns(ring.acquire()), 4);
  EXPECT_TRUE(ring.release(first));
  EXPECT_FALSE(ring.release(first));
}

TEST(FrameRing, NeverTouchesAFrameThatIsLent) {
  FrameRing ring(1);
  bool lost = false;
  for (int t = 0; t < FrameRing::kSlots; ++t) {
    *ring.begin(lost) = static_cast<float>(t);
    ring.end(t);
    EXPECT_EQ(ring.acquire(), t);
  }
  EXPECT_EQ(ring.begin(lost), nullptr);
  for (int t = 0; t < FrameRing::kSlots; ++t) EXPECT_EQ(*ring.depth(t), static_cast<float>(t));
}

}  // namespace
}  // namespace wb::dds
