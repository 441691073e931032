// Entry of the CAN master's fuzzing: one input is a mode, a moment, and frames that somebody puts
// on the master's bus from then on, between calls of the driver. Aborts when a promise is broken.
// Returns how many RPDOs left that enabled a drive.
#pragma once
#include <cstddef>
#include <cstdint>

namespace wb::can {

constexpr std::size_t kFuzzHeader = 2, kFuzzRecord = 12;  // bytes
std::uint64_t fuzz_one(const std::uint8_t* data, std::size_t size);

}  // namespace wb::can
