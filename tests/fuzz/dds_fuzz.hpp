// One hostile sample for the DDS plugin's checks and for the low-level side's, made from bytes.
// Aborts where what comes out breaks a promise. Entry of dds_fuzz.cpp (libFuzzer) and of the
// seeded test.
#pragma once
#include <cstddef>
#include <cstdint>

namespace wb::dds {

// True if the sample was taken.
bool fuzz_one(const std::uint8_t* data, std::size_t size);

}  // namespace wb::dds
