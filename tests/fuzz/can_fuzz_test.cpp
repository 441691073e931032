// The fuzzer's entry with a fixed number of seeded frames, in every build.
#include <gtest/gtest.h>

#include "tests/fuzz/fuzz.hpp"

namespace wb::fuzz {
namespace {

TEST(CanFuzz, TwoHundredThousandSeededFramesBreakNoPromise) {
  std::mt19937_64 random(402);
  Tally total;
  while (total.records < 200'000) {
    const std::vector<std::uint8_t> input = seeded(random);
    const Tally tally = run_one(input.data(), input.size());
    total.records += tally.records;
    total.taken += tally.taken;
  }
  EXPECT_GT(total.taken, 10'000u) << "the promises were put to the test";
}

}  // namespace
}  // namespace wb::fuzz
