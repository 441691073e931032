// What the plugin's section of wholebodyd.yaml says. Setup world: throws config::ConfigError.
#pragma once
#include <string>

#include "core/types/time.hpp"
#include "drivers/robotiq/registers.hpp"

namespace wb::robotiq {

struct Config {
  std::string device;  // serial port; may be a link that udev keeps
  int baud = 115200;
  int slave = 9;
  Stroke stroke;
  std::uint8_t speed = 255;        // of every motion, counts
  TimeNs response_timeout_ns = 0;  // of one exchange
  TimeNs silence_max_ns = 0;       // without an answer: reading fails

  static Config parse(const std::string& text);
};

}  // namespace wb::robotiq
