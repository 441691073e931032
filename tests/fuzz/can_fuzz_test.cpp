// The fuzzer's entry with a fixed number of seeded frames, in every build.
#include "tests/fuzz/can_fuzz.hpp"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace wb::can {
namespace {

// The length that a frame of this identifier should have.
std::uint8_t id_length(std::uint8_t low, std::uint8_t high) {
  const int id = low | high << 8, base = id & 0x780;
  return id == 0 ? 2 : id == 0x080 ? 0 : base == 0x700 ? 1 : base == 0x280 || base == 0x200 ? 7 : 8;
}

TEST(CanFuzz, TwoHundredThousandSeededFramesBreakNoPromise) {
  constexpr int kFrames = 200'000, kPerInput = 100;
  // Half of the identifiers are those that the two drives and the master use.
  constexpr std::uint16_t kIds[] = {0x000, 0x080, 0x081, 0x082, 0x181, 0x182, 0x281, 0x282,
                                    0x201, 0x202, 0x581, 0x582, 0x601, 0x701, 0x702, 0x77F};
  // Words that mean something.
  constexpr std::uint16_t kWords[] = {0x0000, 0x0250, 0x0231, 0x0233, 0x0237, 0x1237, 0x0217,
                                      0x0208, 0x020F, 0x0043, 0x7F43, 0x1860, 0x0005, 0x0080};
  std::uint64_t enabling = 0;
  std::mt19937_64 random(402);
  const auto pick = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
  std::vector<std::uint8_t> input(kFuzzHeader + kPerInput * kFuzzRecord);
  for (int frames = 0; frames < kFrames; frames += kPerInput) {
    for (auto& byte : input) byte = static_cast<std::uint8_t>(random());
    for (int i = 0; i < kPerInput; ++i) {
      std::uint8_t* record = &input[kFuzzHeader + static_cast<std::size_t>(i) * kFuzzRecord];
      if (pick(8)) record[0] &= 0x0F;                    // mostly data frames with 11 bits
      if (pick(16)) record[0] = (record[0] & 0xF0) | 8;  // mostly time goes on
      if (pick(2)) {
        const std::uint16_t id = kIds[pick(std::size(kIds))];
        record[1] = static_cast<std::uint8_t>(id);
        record[2] = static_cast<std::uint8_t>(id >> 8);
      }
      if (pick(4)) record[3] = id_length(record[1], record[2]);
      if (pick(2)) {
        const std::uint16_t word = kWords[pick(std::size(kWords))];
        record[4] = static_cast<std::uint8_t>(word);
        record[5] = static_cast<std::uint8_t>(word >> 8);
      }
      if (pick(2)) std::fill(record + 6, record + 12, 0);
    }
    enabling += fuzz_one(input.data(), input.size());
  }
  EXPECT_GT(enabling, 10'000u) << "the promises were put to the test";
}

}  // namespace
}  // namespace wb::can
