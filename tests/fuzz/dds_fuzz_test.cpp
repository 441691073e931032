// The fuzzer's entry under an ordinary compiler: seeded samples, nearly good ones among them.
#include "tests/fuzz/dds_fuzz.hpp"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace wb::dds {
namespace {

TEST(DdsFuzz, TwoHundredThousandHostileSamplesKeepEveryPromise) {
  constexpr int kSamples = 200'000;
  std::mt19937_64 random(20251125);
  std::vector<std::uint8_t> bytes;
  int taken = 0;
  for (int i = 0; i < kSamples; ++i) {
    bytes.resize(1 + random() % 96);
    // Sparse bytes keep most fields as a good message has them.
    const bool sparse = random() % 2 == 0;
    for (std::uint8_t& b : bytes)
      b = sparse && random() % 8 != 0 ? 0 : static_cast<std::uint8_t>(random());
    bytes[0] = static_cast<std::uint8_t>(random());
    taken += fuzz_one(bytes.data(), bytes.size());
  }
  // Both ways are walked: some are taken, some refused.
  EXPECT_GT(taken, kSamples / 10);
  EXPECT_LT(taken, kSamples * 9 / 10);
}

}  // namespace
}  // namespace wb::dds
