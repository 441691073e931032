// The conformance suite of the driver ABI (drivers/check) on the CAN plugin, against simulated
// drives: sound ones pass, and a drive that does not do what it is told fails the checks that are
// there for it, whether it is the plugin that notices or the suite.
#include <gtest/gtest.h>
#include <unistd.h>

#include "core/rt/allocation_count.hpp"
#include "tests/drivers/can/node_hub.hpp"
#include "tests/drivers/check_results.hpp"

namespace wb::can {
namespace {

using check::expect_failed;
using check::Outcome;
using check::Result;

constexpr int kElbow = 1, kWheel = 3;  // j2, csp; j4, csv

check::Options options_for(const std::filesystem::path& path, bool paced,
                           const std::string& supervision = "") {
  check::Options options;
  options.library = WB_BUILD_DIR "/drivers/libwb_driver_can.so";
  options.config = hub_config(path, paced, supervision);
  options.folder = "/";
  return options;
}

std::filesystem::path socket_path() {
  return std::filesystem::temp_directory_path() / ("wb_can_check_" + std::to_string(::getpid()));
}

std::vector<Result> suite_against(const BrokenDrive& broken) {
  NodeHub hub(socket_path(), true, 4, broken);
  const auto results = check::run(options_for(socket_path(), true));
  for (const Result& r : results) {
    if (r.outcome != Outcome::kPassed) std::printf("%s: %s\n", r.name.c_str(), r.reason.c_str());
  }
  return results;
}

TEST(CanConformance, SoundDrivesPassEveryCheck) {
  const auto results = suite_against({});
  EXPECT_GE(results.size(), 20u);
  for (const Result& r : results) {
    const bool may_skip = r.name == "process_dies" ||  // below, in real time
                          (r.name == "ports_allocate_nothing" && !allocations_are_counted());
    EXPECT_TRUE(r.outcome == Outcome::kPassed || may_skip) << r.name << ": " << r.reason;
  }
}

TEST(CanConformance, ADriveThatIgnoresQuickStopAndDisablingIsFound) {
  BrokenDrive broken{kWheel};
  broken.faults.ignore_stop = true;
  const auto results = suite_against(broken);
  expect_failed(results, "time_out", "joint j4 moved by");
  expect_failed(results, "stop", "joint j4 moved by");
  expect_failed(results, "deactivate", "joint j4 moved by");
}

TEST(CanConformance, ADriveThatMovesByItselfIsFoundBeforeTheFirstWrite) {
  BrokenDrive broken{kElbow};
  broken.creep_radps = 0.05;
  expect_failed(suite_against(broken), "still_until_written", "joint j2 moved by");
}

TEST(CanConformance, ADriveThatIsEnabledButFollowsNoTargetIsFound) {
  for (const int drive : {kElbow, kWheel}) {
    BrokenDrive broken{drive};
    broken.faults.ignore_targets = true;
    const auto results = suite_against(broken);
    EXPECT_EQ(check::failed(results), std::vector<std::string>{"follows"});
    expect_failed(
        results, "follows",
        "joint j" + std::to_string(drive + 1) + " has status FOLLOWING, but moved by 0 when");
  }
}

TEST(CanConformance, ADriveWhoseEncoderRunsBackwardsIsFound) {
  BrokenDrive broken{kElbow};
  broken.faults.reversed = true;
  expect_failed(suite_against(broken), "stamps", "j2 (node 2): the measured position jumped");
}

TEST(CanConformance, ADriveThatCannotBeEnabledIsFound) {
  BrokenDrive broken{kElbow};
  broken.faults.refuse_enable = true;
  expect_failed(suite_against(broken), "status", "joint j2 has status DISABLED");
}

TEST(CanConformance, ADriveWithoutAHeartbeatConsumerIsRefusedAtItsSetUp) {
  BrokenDrive broken{kElbow};
  broken.heartbeat_consumer = false;
  expect_failed(suite_against(broken), "describe",
                "j2 (node 2): the drive aborts SDO, code 0x6020000 (no such object)");
}

// The drives' own time-out needs a bus that goes on without its master: real time.
class CanConformanceInRealTime : public ::testing::Test {
 protected:
  static Result process_dies(const BrokenDrive& broken) {
    NodeHub hub(socket_path(), false, 4, broken);
    // Patient enough for a loaded machine, but for the drives' time-out itself.
    check::Options options = options_for(
        socket_path(), false,
        "supervision: {tpdo_lost_max: 1000, tpdo_window: 1, heartbeat_lost_ms: 10000, "
        "rpdo_timeout_ms: 1000, sdo_timeout_ms: 2000, setup_timeout_ms: 60000, enable_timeout_ms: "
        "30000, following_ms: 20000, duplicates_max: 1000, command_age_ms: 5000}\n");
    options.only = "process_dies";
    options.rate_hz = 100;
    options.timeout_ms = 2000;
    options.start_s = 60;
    return check::run(options).back();
  }
};

TEST_F(CanConformanceInRealTime, SoundDrivesStopByThemselvesWhenTheMasterDies) {
  const Result r = process_dies({});
  EXPECT_EQ(r.name, "process_dies");
  EXPECT_EQ(r.outcome, Outcome::kPassed) << r.reason;
}

TEST_F(CanConformanceInRealTime, ADriveThatRunsOnWithoutItsMasterIsFound) {
  BrokenDrive broken{kWheel};
  broken.faults.ignore_silence = true;
  const Result r = process_dies(broken);
  EXPECT_EQ(r.outcome, Outcome::kFailed);
  EXPECT_NE(r.reason.find("joint j4 moved by"), std::string::npos) << r.reason;
}

}  // namespace
}  // namespace wb::can
