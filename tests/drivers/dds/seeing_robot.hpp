// A paced FakeRobot with a depth camera and a truth, for whoever looks at what belongs to a tick.
#pragma once
#include <array>
#include <cstring>

#include "tests/drivers/dds/fake_robot.hpp"

namespace wb::dds {

// Publishes truth at every 10 ms, and a frame of 4 x 3 pixels at every 20 ms, whose first pixel is
// the time in seconds.
class SeeingRobot : public FakeRobot {
 public:
  SeeingRobot() : FakeRobot(fake_description(), true) {}
  static LowLevelCamera camera() { return {"camera_front", "front/depth", 4, 3, 10, 10, 2, 1.5}; }
  // What of the plugin's configuration takes it all.
  static constexpr const char* kConfig =
      ", truth: true, cameras: [{name: camera_front, image: front/depth, info: front/camera_info, "
      "rate_hz: 50, range_min_m: 0.1, range_max_m: 8}]";
  LowLevel* low_level = nullptr;

  bool advance(TimeNs t) override {
    for (; next_ <= t; next_ += 10'000'000) {
      FakeRobot::advance(next_);
      LowLevel::Truth truth;
      truth.t_ns = next_;
      truth.base_pose = {{to_seconds(next_), 2, 0}, {0, 0, 0, 1}};
      truth.spawn_pose = {{1, 2, 0}, {0, 0, 0, 1}};
      LowLevel::Truth::Object drawer;
      std::strcpy(drawer.object.name, "drawer_1");
      drawer.object.value = readings().joints[0].position;
      drawer.object.range = 0.45;
      drawer.clearance = 0.125;
      drawer.X_GE = {{0.25, 0, 0}, {0, 0, 0, 1}};
      truth.objects.push_back(drawer);
      truth.contacts.push_back({next_, "finger", "door", "oven"});
      truth.contact_count = 1;
      truth.links.push_back({"camera_shoulder", {{0, 0, 1.5}, {0, 0, 0, 1}}});
      truth.clearance = 0.0625;
      low_level->publish_truth(truth);
      if (next_ % 20'000'000 != 0) continue;
      std::array<float, 12> depth;
      depth.fill(2);
      depth[0] = static_cast<float>(to_seconds(next_));
      depth[1] = -1;
      low_level->publish_depth(0, next_, depth.data());
    }
    return FakeRobot::advance(t);
  }

 private:
  TimeNs next_ = 0;
};

}  // namespace wb::dds
