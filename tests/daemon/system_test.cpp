// The wired system in lockstep: what a run depends on.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/scenario/run.hpp"

namespace wb {
namespace {

// Long enough for every loop to have delivered: policies, fields, a plan.
std::uint64_t hash_of_run(std::uint64_t seed) {
  test::SimulatedRun run(test::RunOptions{.seed = seed});
  run.reset();
  run.open("drawer_1");
  run.run_for(1.5);
  EXPECT_GT(run.system().mpc_record().field_seq, 0u);
  EXPECT_EQ(run.mode(), Mode::kActive);
  return run.system().state_hash();
}

TEST(System, SameSeedGivesTheSameHashAgainAndInAnotherProcess) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    const std::uint64_t hash = hash_of_run(7);
    _exit(write(ends[1], &hash, sizeof hash) == sizeof hash ? 0 : 1);
  }
  close(ends[1]);
  const std::uint64_t first = hash_of_run(7);
  EXPECT_EQ(hash_of_run(7), first);
  std::uint64_t childs = 0;
  EXPECT_EQ(read(ends[0], &childs, sizeof childs), static_cast<ssize_t>(sizeof childs));
  EXPECT_EQ(childs, first);
  close(ends[0]);
  int status = 0;
  EXPECT_EQ(waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
}

TEST(System, AnotherSeedGivesAnotherHash) { EXPECT_NE(hash_of_run(7), hash_of_run(8)); }

TEST(System, DropsNoRecordStateOrFrame) {
  test::SimulatedRun run(test::RunOptions{.seed = 7});
  run.reset();
  run.open("drawer_1");
  run.run_for(1.5);
  Arrows& arrows = run.system().arrows();
  EXPECT_EQ(arrows.frames.dropped(), 0u);
  EXPECT_EQ(arrows.states_to_mapping.dropped(), 0u);
  EXPECT_EQ(arrows.states_to_perception.dropped(), 0u);
  EXPECT_EQ(arrows.statuses.dropped(), 0u);
  EXPECT_EQ(run.truth().frames_dropped(run.driver()), 0u);
}

}  // namespace
}  // namespace wb
