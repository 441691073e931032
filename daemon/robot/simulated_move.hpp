// A robot's folder through the whole daemon in lockstep: from stowed to ready on an empty floor of
// the simulator. Setup world; virtual time, so it is deterministic. Frames: S, W; SI units.
#pragma once
#include <filesystem>

#include "daemon/robot/robot_check.hpp"

namespace wb {

// Loads every file of the folder strictly; what cannot be simulated is a failed line with the
// reason.
CheckLine check_simulated_move(const std::filesystem::path& folder, unsigned seed);

}  // namespace wb
