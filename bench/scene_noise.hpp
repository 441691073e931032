// The sensor noise of a scene, as its file states it: every bench on a simulated run prints it.
// Setup world. Units are in the keys.
#pragma once
#include <filesystem>
#include <sstream>
#include <string>

#include "core/config/config.hpp"

namespace wb::bench {

// The `noise` section as a JSON object. Throws config::ConfigError.
inline std::string scene_noise_json(const std::filesystem::path& scene) {
  const config::Section noise = config::Section::open(scene).section("noise");
  std::ostringstream out;
  for (const std::string& key : noise.keys())
    out << (out.tellp() > 0 ? ", \"" : "{\"") << key << "\": " << noise.number(key);
  out << "}";
  return out.str();
}

}  // namespace wb::bench
