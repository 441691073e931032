// What each fuzzed entry (NAME_fuzz_one.cpp) offers to libFuzzer (fuzz_main.cpp) and to its
// ordinary test: one input of many records, checked against the promises that its file states.
#pragma once
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

namespace wb::fuzz {

struct Tally {
  std::uint64_t records = 0;  // fed
  std::uint64_t taken = 0;    // what the promises are about: kTaken
};
extern const char* const kName;
extern const char* const kRecords;
extern const char* const kTaken;

// Feeds one input. Aborts when a promise is broken.
Tally run_one(const std::uint8_t* data, std::size_t size);

// An input of which much is as it should be, so that it reaches deep.
std::vector<std::uint8_t> seeded(std::mt19937_64& random);

}  // namespace wb::fuzz
