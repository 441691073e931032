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

class Tuning : public ::testing::Test {
 protected:
  static constexpr char kWeight[] = "end_effector.position_pm2";
  void SetUp() override {
    run.reset();
    run.open("drawer_1");
    run.run_for(0.5);
    ASSERT_EQ(run.system().solve_report().weights_revision, 0u);
  }
  double value() {
    const int i = run.system().problem().weights().find(kWeight);
    return run.system().mpc_record().weights.values[i];
  }
  test::SimulatedRun run{{.seed = 7}};
};

TEST_F(Tuning, ASetWeightIsTheNextSolves) {
  const double configured = value();
  const std::uint64_t id = run.tune(kWeight, 2 * configured);
  run.run_for(0.1);
  EXPECT_EQ(run.outcome(id), RequestOutcome::kSucceeded);
  EXPECT_EQ(run.system().solve_report().weights_revision, 1u);
  EXPECT_EQ(value(), 2 * configured);
  EXPECT_EQ(run.mode(), Mode::kActive) << "the task goes on";

  const std::uint64_t back = run.revert();
  run.run_for(0.1);
  EXPECT_EQ(run.outcome(back), RequestOutcome::kSucceeded);
  EXPECT_EQ(run.system().solve_report().weights_revision, 2u);
  EXPECT_EQ(value(), configured);
}

TEST_F(Tuning, ARefusedOneChangesNothing) {
  const double configured = value();
  const std::uint64_t far = run.tune(kWeight, 1e9), none = run.tune("no.such", 1);
  run.run_for(0.1);
  EXPECT_EQ(run.outcome(far), RequestOutcome::kRefused);
  EXPECT_EQ(run.outcome(none), RequestOutcome::kRefused);
  EXPECT_EQ(run.system().solve_report().weights_revision, 0u);
  EXPECT_EQ(value(), configured);
}

TEST_F(Tuning, RevertOfOneWeightLeavesTheOthers) {
  const double configured = value();
  run.tune(kWeight, 2 * configured);
  run.tune("end_effector.orientation_prad2", 1.0);
  run.revert(kWeight);
  run.run_for(0.1);
  const WeightTable& table = run.system().problem().weights();
  EXPECT_EQ(run.system().solve_report().weights_revision, 3u);
  EXPECT_EQ(value(), configured);
  EXPECT_EQ(run.system().mpc_record().weights.values[table.find("end_effector.orientation_prad2")],
            1.0);
}

TEST_F(Tuning, TheServiceSeesWeightsCountersAndCpuTime) {
  run.tune(kWeight, 70);
  run.run_for(0.1);
  const MpcRecord* shown = run.system().arrows().mpc.read();
  ASSERT_NE(shown, nullptr);
  EXPECT_EQ(shown->weights.revision, 1u);
  EXPECT_GT(shown->counters.solves, 10u);
  EXPECT_GT(shown->cpu_ns, 0);
  const Reference* planned = run.system().arrows().planned.read();
  ASSERT_NE(planned, nullptr);
  EXPECT_GT(planned->base_count, 1) << "with the base's route";
}

}  // namespace
}  // namespace wb
