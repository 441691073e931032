// What the map is worth: the way to the pre-grasp pose from random starts, with it and without it.
#include <gtest/gtest.h>

#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::SimulatedRun;

// Seeds that nothing was tuned on.
constexpr int kRuns = 20;
constexpr std::uint64_t kFirstSeed = 1000;

// False: the sequencer never went on to the grasp.
bool reach_pre_grasp(SimulatedRun& run) {
  run.reset();
  const std::uint64_t id = run.open("drawer_1");
  return run.run_until([&] { return run.ended(id) || run.phase() == Phase::kGrasp; }, 60) &&
         !run.ended(id);
}

TEST(PreGrasp, IsReachedFromEveryStartWithoutTouchingAnything) {
  for (std::uint64_t seed = kFirstSeed; seed < kFirstSeed + kRuns; ++seed) {
    SimulatedRun run({.seed = seed});
    EXPECT_TRUE(reach_pre_grasp(run)) << "seed " << seed;
    EXPECT_EQ(run.contacts(), 0u) << "seed " << seed << ": " << run.contact_names();
  }
}

// Otherwise the fact above would say nothing about the map.
TEST(PreGrasp, WithoutTheMapAtLeastThreeOfTheSameRunsCollide) {
  int collided = 0;
  for (std::uint64_t seed = kFirstSeed; seed < kFirstSeed + kRuns; ++seed) {
    SimulatedRun run({.seed = seed, .blind = true});  // as `articulated --no-environment`
    (void)reach_pre_grasp(run);
    collided += run.contacts() > 0;
  }
  EXPECT_GE(collided, 3);
}

}  // namespace
}  // namespace wb
