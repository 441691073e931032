// Parts over DDS beside joints on another bus: standard IMU, wrench and camera messages as ROS
// drivers publish them, and the gripper alone.
#include <cmath>
#include <cstring>

#include "drivers/dds/messages.hpp"
#include "tests/drivers/dds/dds_fixture.hpp"

namespace wb::dds {
namespace {

constexpr int kWidth = 4, kHeight = 3;

// Publishes at 100 Hz what a ROS robot does.
class RosSensors {
 public:
  explicit RosSensors(int domain)
      : participant_(make_participant(domain, "sensors")),
        imu_(participant_, "rt/imu/data", kNewest),
        wrench_(participant_, "rt/wrist/wrench", kNewest),
        image_(participant_, "rt/front/depth", kFrameWriter),
        points_(participant_, "rt/lidar/points", kFrameWriter),
        front_(participant_, "rt/front/camera_info", kNewest),
        lidar_(participant_, "rt/lidar/camera_info", kNewest),
        thread_([this] {
          while (!stopping_) {
            publish();
            sleep_s(0.01);
          }
        }) {}
  ~RosSensors() {
    stopping_ = true;
    thread_.join();
  }
  std::atomic<bool> bad_encoding{false}, bad_frame{false}, other_camera{false}, old_frames{false},
      silent_imu{false};

 private:
  void publish() {
    const TimeNs now = clock_ns(CLOCK_REALTIME);
    msg::Imu imu{};
    imu.header_ = {to_message(now), text("base")};
    imu.angular_velocity_.z_ = 0.25;
    imu.linear_acceleration_.z_ = 9.81;
    if (!silent_imu) imu_.write(imu);
    msg::WrenchStamped wrench{};
    wrench.header_ = {to_message(now), text("hand")};
    wrench.wrench_.force_.x_ = 12;
    wrench_.write(wrench);

    msg::CameraInfo info{};
    info.header_ = {to_message(now), text("camera_front")};
    info.width_ = other_camera ? 2 * kWidth : kWidth;
    info.height_ = kHeight;
    info.distortion_model_ = text("plumb_bob");
    info.k_[0] = info.k_[4] = 10;
    info.k_[2] = 1.5;
    info.k_[5] = 1;
    front_.write(info);
    info.width_ = kWidth;
    lidar_.write(info);

    std::uint16_t pixels[kWidth * kHeight];
    std::fill_n(pixels, kWidth * kHeight, std::uint16_t{1500});
    msg::Image image{};
    image.header_ = {to_message(old_frames ? now - 10 * kNanosPerSecond : now),
                     text(bad_frame ? "elsewhere" : "camera_front")};
    image.width_ = kWidth;
    image.height_ = kHeight;
    image.encoding_ = text(bad_encoding ? "rgb8" : "16UC1");
    image.step_ = kWidth * 2;
    image.data_ = {sizeof pixels, sizeof pixels, reinterpret_cast<std::uint8_t*>(pixels), false};
    image_.write(image);

    float point[3] = {0, 0, 2};
    msg::PointField fields[3];
    const char* names[] = {"x", "y", "z"};
    for (std::uint32_t i = 0; i < 3; ++i) fields[i] = {text(names[i]), 4 * i, 7, 1};
    msg::PointCloud2 cloud{};
    cloud.header_ = {to_message(now), text("lidar_optical")};
    cloud.width_ = cloud.height_ = 1;
    cloud.fields_ = {3, 3, fields, false};
    cloud.point_step_ = cloud.row_step_ = sizeof point;
    cloud.data_ = {sizeof point, sizeof point, reinterpret_cast<std::uint8_t*>(point), false};
    points_.write(cloud);
  }

  Entity participant_;
  Writer<msg::Imu> imu_;
  Writer<msg::WrenchStamped> wrench_;
  Writer<msg::Image> image_;
  Writer<msg::PointCloud2> points_;
  Writer<msg::CameraInfo> front_, lidar_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class PartsTest : public DdsDriverTest {
 protected:
  void SetUp() override {
    sensors = std::make_unique<RosSensors>(domain());
    plugin = std::make_unique<Plugin>(
        "{domain: " + std::to_string(domain()) +
        ", prefix: robot, clock: ros, joints: none, imu: imu/data, wrench: wrist/wrench, "
        "sample_memory_ms: 400, silence_ms: 1000, frame_memory_ms: 2000, cameras: ["
        "{name: camera_front, image: front/depth, info: front/camera_info, rate_hz: 15, "
        "range_min_m: 0.1, range_max_m: 8}, "
        "{name: lidar, frame: lidar_optical, points: lidar/points, info: lidar/camera_info, "
        "rate_hz: 15, range_min_m: 0.1, range_max_m: 30}]}");
  }
  void TearDown() override { plugin.reset(); }

  // Takes frames of the camera until one satisfies the condition.
  bool frame_until(std::uint32_t camera, const std::function<bool(const wb_frame&)>& condition) {
    return wait_until([&] {
      wb_frame frame;
      bool found = false;
      while (plugin->api().acquire_frame(plugin->get(), &frame) == WB_OK) {
        found = found || (frame.camera == camera && condition(frame));
        plugin->api().release_frame(plugin->get(), frame.token);
      }
      return found;
    });
  }

  std::unique_ptr<RosSensors> sensors;
};

TEST_F(PartsTest, StandardMessagesServeARobotWhoseJointsAreElsewhere) {
  EXPECT_EQ(plugin->description.joint_count, 0u);
  EXPECT_EQ(plugin->description.has_imu + plugin->description.has_wrench, 2u);
  EXPECT_EQ(plugin->description.has_gripper, 0u);
  ASSERT_EQ(plugin->description.camera_count, 2u);
  EXPECT_EQ(plugin->description.cameras[0].width, 4u);
  EXPECT_DOUBLE_EQ(plugin->description.cameras[0].cx, 2.0);
  ASSERT_EQ(plugin->activate(), WB_OK) << "there is nothing to lease";
  ASSERT_EQ(plugin->read(), WB_OK);
  EXPECT_EQ(plugin->readings.imu.valid + plugin->readings.wrench.valid, 2u);
  EXPECT_DOUBLE_EQ(plugin->readings.imu.gyro[2], 0.25);
  EXPECT_DOUBLE_EQ(plugin->readings.wrench.force[0], 12);
  EXPECT_TRUE(frame_until(0, [](const wb_frame& f) { return f.depth[11] == 1.5f; }));
  EXPECT_TRUE(frame_until(1, [](const wb_frame& f) {
    return f.depth[6] == 2.0f && std::isinf(f.depth[0]);  // the ray through (2, 1.5)
  }));
}

TEST_F(PartsTest, ASilentSensorIsInvalidAndTheOthersStay) {
  sensors->silent_imu = true;
  EXPECT_TRUE(wait_until([&] { return plugin->read() == WB_OK && !plugin->readings.imu.valid; }));
  EXPECT_TRUE(wait_until([&] { return plugin->read() == WB_OK && plugin->readings.wrench.valid; }));
}

TEST_F(PartsTest, BadFramesAreCountedByKindAndDropped) {
  const auto grows = [&](std::atomic<bool>& fault, const char* counter) {
    fault = true;
    const bool counted = wait_until([&] { return plugin->count(counter) >= 3; });
    fault = false;
    return counted;
  };
  EXPECT_TRUE(grows(sensors->bad_encoding, "frames.encoding"));
  EXPECT_TRUE(grows(sensors->bad_frame, "frames.wrong_source"));
  EXPECT_TRUE(grows(sensors->other_camera, "frames.uncalibrated"));
  EXPECT_TRUE(grows(sensors->old_frames, "frames.stale"));
  const TimeNs now = clock_ns(CLOCK_MONOTONIC);
  EXPECT_TRUE(frame_until(0, [&](const wb_frame& f) { return f.t_ns > now; })) << "it goes on";
}

TEST_F(PartsTest, FramesThatNobodyTakesAreGivenUpOldestFirst) {
  ASSERT_TRUE(wait_until([&] { return plugin->count("frames.lost") > 20; }));
  wb_frame first, second;
  ASSERT_EQ(plugin->api().acquire_frame(plugin->get(), &first), WB_OK);
  ASSERT_EQ(plugin->api().acquire_frame(plugin->get(), &second), WB_OK);
  EXPECT_NE(first.depth, second.depth);
  const float before = first.depth[0];
  const std::uint64_t lost = plugin->count("frames.lost");
  ASSERT_TRUE(wait_until([&] { return plugin->count("frames.lost") > lost + 20; }));
  EXPECT_EQ(first.depth[0], before) << "what is lent stays";
}

TEST_F(DdsDriverTest, TheGripperAloneIsCommandedUnderALease) {
  start_low_level();
  plugin = std::make_unique<Plugin>("{domain: " + std::to_string(domain()) +
                                    ", prefix: robot, clock: ros, joints: none, gripper: true}");
  ASSERT_EQ(plugin->description.joint_count, 0u);
  ASSERT_EQ(plugin->activate(), WB_OK) << plugin->log();
  wb_commands c{};
  c.gripper.opening = 0.015;
  c.gripper.force = 30;
  EXPECT_TRUE(write_until(c, [&] { return robot().readings().gripper.opening == 0.015; }));
  EXPECT_EQ(robot().travel(), 0);
}

}  // namespace
}  // namespace wb::dds
