// The layer's fact: drawer_1 opens, from the command to the retreat; and the recording of such a
// run replays.
#include <gtest/gtest.h>

#include "daemon/replay.hpp"
#include "daemon/run_observer.hpp"
#include "tests/scenario/recording_file.hpp"
#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::SimulatedRun;

constexpr std::uint64_t kSeed = 3000;  // nothing was tuned on it

TEST(Drawer, OpensWithoutTouchingAnythingElseAndWithoutSlip) {
  SimulatedRun run({.seed = kSeed});
  RunObserver observer(run.system(), "drawer_1", RunObserver::threshold("drawer_1"));
  run.reset();
  const std::uint64_t id = run.open("drawer_1");
  while (!run.ended(id) && run.now() < 60 * kNanosPerSecond) {
    run.step();
    observer.sample(run.now());
  }
  EXPECT_EQ(run.outcome(id), RequestOutcome::kSucceeded) << run.status(id).reason.view();
  EXPECT_TRUE(observer.result().opened);
  EXPECT_EQ(observer.result().collisions, 0) << observer.result().first_collision;
  EXPECT_LT(observer.result().slip_m, 0.005);
}

TEST(Drawer, RecordingOfItsOpeningReplaysBitForBit) {
  const test::RecordingFile file;
  SimulatedRun run({.seed = kSeed});
  run.record(file.path());
  run.reset();
  ASSERT_TRUE(run.run_to_end(run.open("drawer_1"), 60));
  run.stop_recording();
  const std::uint64_t control = run.system().state().seq, hash = run.system().state_hash();

  const ReplayResult result = replay(file.path());
  EXPECT_TRUE(result.equal) << result.problem << ", first difference at "
                            << result.first_difference;
  EXPECT_EQ(result.control_steps, control);
  EXPECT_EQ(result.state_hash, hash);
  const RecordingReader in(file.path());
  EXPECT_EQ(result.mpc_steps, in.mpc.size());
  EXPECT_EQ(result.mapping_steps, in.mapping.size());
  EXPECT_FALSE(in.truncated);
}

}  // namespace
}  // namespace wb
