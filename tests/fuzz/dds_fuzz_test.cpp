// The fuzzer's entry with a fixed number of seeded samples, in every build.
#include <gtest/gtest.h>

#include "tests/fuzz/fuzz.hpp"

namespace wb::fuzz {
namespace {

constexpr std::uint8_t kKinds = 7;

class DdsFuzz : public ::testing::TestWithParam<std::uint8_t> {};

TEST_P(DdsFuzz, ThirtyThousandSeededSamplesBreakNoPromise) {
  std::mt19937_64 random(20251125);
  Tally total;
  while (total.records < 30'000) {
    std::vector<std::uint8_t> input = seeded(random);
    input[0] = GetParam();
    const Tally tally = run_one(input.data(), input.size());
    total.records += tally.records;
    total.taken += tally.taken;
  }
  // Both ways are walked: some are taken, some refused.
  EXPECT_GT(total.taken, total.records / 10);
  EXPECT_LT(total.taken, total.records * 9 / 10);
}

std::string name_of(const ::testing::TestParamInfo<std::uint8_t>& info) {
  constexpr const char* kNames[kKinds] = {"LowLevelSession", "Measurements", "Image", "PointCloud",
                                          "CameraInfo",      "Imu",          "Truth"};
  return kNames[info.param];
}
INSTANTIATE_TEST_SUITE_P(Kinds, DdsFuzz, ::testing::Range(std::uint8_t{0}, kKinds), name_of);

}  // namespace
}  // namespace wb::fuzz
