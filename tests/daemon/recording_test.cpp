// What a recording proves, and what becomes of files that are damaged or of another build.
#include <gtest/gtest.h>

#include <cstddef>

#include "daemon/replay.hpp"
#include "tests/scenario/recording_file.hpp"
#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::line_start;
using test::record_start;

// Records the first second of an approach; the loops have all delivered by then.
class Recording : public ::testing::Test {
 protected:
  void SetUp() override {
    test::SimulatedRun run(test::RunOptions{.seed = 7});
    run.record(file.path());
    run.reset();
    run.open("drawer_1");
    run.run_for(1);
    run.stop_recording();
    hash = run.system().state_hash();
    steps = run.system().state().seq;
    bytes = file.bytes();
  }

  // Why the file cannot be replayed; empty if it can.
  std::string refusal() const {
    try {
      return replay(file.path()).problem;
    } catch (const std::runtime_error& e) {
      return e.what();
    }
  }

  test::RecordingFile file;
  std::string bytes;
  std::uint64_t hash = 0, steps = 0;
};

TEST_F(Recording, ReplaysBitForBit) {
  const ReplayResult result = replay(file.path());
  EXPECT_TRUE(result.equal) << result.problem;
  EXPECT_EQ(result.first_difference, -1);
  EXPECT_EQ(result.control_steps, steps);
  EXPECT_GT(result.mpc_steps, 0u);
  EXPECT_GT(result.mapping_steps, 0u);
  EXPECT_EQ(result.state_hash, hash);
}

TEST_F(Recording, OneFlippedBitOfAGyroSampleIsFoundInItsStep) {
  for (const std::uint64_t step : {std::uint64_t{1}, steps / 2, steps - 1}) {
    const std::size_t at = record_start(bytes, RecordType::kControl, step) +
                           offsetof(ControlRecord, readings) + offsetof(Readings, gyro);
    std::string changed = bytes;
    changed[at] = static_cast<char>(changed[at] ^ 1);  // the x axis, its least significant bit
    file.write(changed);
    const ReplayResult result = replay(file.path());
    EXPECT_FALSE(result.equal);
    EXPECT_EQ(result.first_difference, static_cast<std::int64_t>(step));
    EXPECT_EQ(result.control_steps, steps);
    EXPECT_EQ(result.problem, "");
  }
}

TEST_F(Recording, CutOffInARecordReplaysUpToThereAndSaysSo) {
  for (const RecordType type : {RecordType::kControl, RecordType::kFrame}) {
    const std::size_t in_record = record_start(bytes, type, 5) + 100;
    file.write(bytes.substr(0, in_record));
    EXPECT_TRUE(RecordingReader(file.path()).truncated) << static_cast<int>(type);
    const ReplayResult result = replay(file.path());
    EXPECT_TRUE(result.equal) << result.problem;
    EXPECT_LT(result.control_steps, steps);
  }
}

TEST_F(Recording, CutOffAnywhereIsNeverWorseThanARefusal) {
  const std::size_t first_record = line_start(bytes, 5);
  for (std::size_t length = 0; length < first_record; ++length) {
    file.write(bytes.substr(0, length));
    EXPECT_NE(refusal(), "") << length;
  }
  for (std::size_t length = first_record; length < first_record + 2000; length += 37) {
    file.write(bytes.substr(0, length));
    EXPECT_EQ(RecordingReader(file.path()).truncated, length > first_record) << length;
  }
}

TEST_F(Recording, OfAnotherBuildIsRefused) {
  bytes[line_start(bytes, 1)] ^= 1;
  file.write(bytes);
  EXPECT_NE(refusal().find("another build"), std::string::npos) << refusal();
}

TEST_F(Recording, OfARobotWhoseFilesHaveChangedIsNotReplayed) {
  char& digit = bytes[line_start(bytes, 4) - 2];  // the last of the hash
  digit = digit == '1' ? '2' : '1';
  file.write(bytes);
  EXPECT_NE(refusal().find("have changed"), std::string::npos) << refusal();
}

TEST_F(Recording, WithARecordOfUnknownTypeOrSizeIsRefused) {
  for (const std::size_t back : {std::size_t{5}, std::size_t{4}}) {  // type, size
    std::string changed = bytes;
    changed[record_start(bytes, RecordType::kControl, 3) - back] ^= 64;
    file.write(changed);
    EXPECT_NE(refusal().find("damaged"), std::string::npos) << refusal();
  }
}

TEST(TunedRecording, ReplaysBitForBit) {
  const test::RecordingFile file;
  test::SimulatedRun run({.seed = 7});
  run.record(file.path());
  run.reset();
  run.open("drawer_1");
  run.run_for(0.5);
  run.tune("input.base_velocity_s2pm2", 30);
  run.run_for(0.5);
  run.stop_recording();
  ASSERT_EQ(run.system().solve_report().weights_revision, 1u);
  const ReplayResult result = replay(file.path());
  EXPECT_TRUE(result.equal) << result.problem;
  EXPECT_EQ(result.state_hash, run.system().state_hash());

  // The weights matter: without them the replay would differ.
  std::string bytes = file.bytes();
  const std::size_t records = RecordingReader(file.path()).mpc.size();
  for (std::size_t i = 0; i < records; ++i) {
    const Weights configured = run.system().problem().weights().configured();
    bytes.replace(test::record_start(bytes, RecordType::kMpc, i) + offsetof(MpcRecord, weights),
                  sizeof configured, reinterpret_cast<const char*>(&configured), sizeof configured);
  }
  file.write(bytes);
  EXPECT_FALSE(replay(file.path()).equal);
}

TEST(NoRecording, IsRefused) {
  const test::RecordingFile file;
  EXPECT_THROW(replay(file.path()), std::runtime_error) << "there is no such file";
  for (const char* text : {"", "\n", "t_s,phase\n0.0,none\n"}) {
    file.write(text);
    EXPECT_THROW(replay(file.path()), std::runtime_error) << text;
    EXPECT_EQ(replay_main(file.path(), false), 2);
  }
}

}  // namespace
}  // namespace wb
