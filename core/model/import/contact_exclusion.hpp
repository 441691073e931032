// Pairs of links whose mutual contact the plant leaves out: neighbours, one rigid body, and what
// overlaps by its shape whatever the posture. Setup world; seeded, deterministic.
#pragma once
#include <cstdint>
#include <vector>

#include "core/model/import/room_files.hpp"

namespace wb {

// The model's config holds the postures.
std::vector<ExcludedContact> excluded_contacts(const UrdfDocument& document,
                                               const RobotStructure& structure,
                                               const RobotModel& model, std::uint64_t seed);

}  // namespace wb
