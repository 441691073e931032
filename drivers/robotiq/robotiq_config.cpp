#include "drivers/robotiq/robotiq_config.hpp"

#include "core/config/config.hpp"

namespace wb::robotiq {

Config Config::parse(const std::string& text) {
  const config::Section s = config::Section::parse(text, "robotiq driver");
  Config out;
  out.device = s.text("device");
  if (s.has("baud")) out.baud = s.integer("baud", {9600, 115200});
  if (s.has("slave")) out.slave = s.integer("slave", {1, 247});
  out.stroke.opening_max_m = s.number("opening_max_m", {0.01, 0.2});
  if (s.has("open_counts")) out.stroke.open_counts = s.integer("open_counts", {0, 100});
  if (s.has("closed_counts")) out.stroke.closed_counts = s.integer("closed_counts", {101, 255});
  out.speed = speed_counts(s.number_or("speed_mps", kSpeedMax_mps, {kSpeedMin_mps, kSpeedMax_mps}));
  out.response_timeout_ns = from_seconds(1e-3 * s.number_or("response_timeout_ms", 20, {5, 500}));
  out.silence_max_ns = from_seconds(1e-3 * s.number_or("silence_max_ms", 250, {50, 5000}));
  s.finish();
  return out;
}

}  // namespace wb::robotiq
