// Builds the scene's furniture from its sections, one function for each type. Setup world; metres,
// radians, kg. Dimensions and joint values: config/scenes/kitchen_line.yaml says where they come
// from.
#pragma once
#include "drivers/sim/scene.hpp"

namespace wb::sim {

// One entry of the scene's `items`. Throws config::ConfigError.
Unit build_unit(const config::Section& item, const config::Section* overrides);

}  // namespace wb::sim
