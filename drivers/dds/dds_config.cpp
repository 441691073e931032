#include "drivers/dds/dds_config.hpp"

namespace wb::dds {
namespace {

TimeNs milliseconds(const config::Section& s, const std::string& key, double otherwise) {
  return from_seconds(1e-3 * s.number_or(key, otherwise, config::kPositive));
}

std::string source(const config::Section& s, const std::string& key) {
  const std::string value = s.text_or(key, "none");
  return value == "none" ? "" : value;
}

}  // namespace

DdsConfig DdsConfig::parse(const std::string& text) {
  const config::Section root = config::Section::parse(text, "driver dds");
  DdsConfig out;
  out.domain = root.integer("domain", {0, 232});
  out.prefix = root.text("prefix");
  out.paced = root.one_of("clock", {"ros", "paced"}) == "paced";
  if (root.is_scalar("joints")) {
    out.all_joints = root.one_of("joints", {"all", "none"}) == "all";
  } else {
    out.joints = root.texts("joints");
  }
  out.imu = source(root, "imu");
  out.wrench = source(root, "wrench");
  out.gripper = root.boolean_or("gripper", false);
  out.truth = root.boolean_or("truth", false);
  if (root.has("cameras")) {
    for (const config::Section& s : root.sections("cameras")) {
      CameraSource camera;
      camera.name = s.text("name");
      camera.frame = s.text_or("frame", camera.name);
      if (s.has("points") == s.has("image"))
        s.fail("image", "or 'points' must name the camera's topic, one of the two");
      camera.points = s.has("points");
      camera.topic = s.text(camera.points ? "points" : "image");
      camera.info = s.text("info");
      camera.rate_hz = s.number("rate_hz", config::kPositive);
      camera.range_min_m = s.number("range_min_m", config::kNonNegative);
      camera.range_max_m = s.number("range_max_m", {camera.range_min_m});
      s.finish();
      out.cameras.push_back(std::move(camera));
    }
    if (out.cameras.size() > 8) root.fail("cameras", "may hold 8 at most");
  }
  out.connect_timeout_ns = milliseconds(root, "connect_timeout_ms", 10'000);
  out.sample_memory_ns = milliseconds(root, "sample_memory_ms", 50);
  out.silence_ns = milliseconds(root, "silence_ms", 100);
  out.frame_memory_ns = milliseconds(root, "frame_memory_ms", 500);
  out.tick_timeout_ns = milliseconds(root, "tick_timeout_ms", 2'000);
  root.finish();
  return out;
}

}  // namespace wb::dds
