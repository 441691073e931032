// The conformance suite: plugins that conform pass, and each defect fails the check that is there
// for it, with the reason, and no other.
#include "drivers/check/driver_check.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "core/config/config.hpp"
#include "core/rt/allocation_count.hpp"

namespace wb::check {
namespace {

Options motors(const std::string& defect) {
  Options options;
  options.library = WB_BROKEN_DIR "/libwb_driver_broken_" + defect + ".so";
  options.config = "{kind: motors}";
  options.folder = ".";
  return options;
}

std::string failures(const std::vector<Result>& results) {
  std::string out;
  for (const Result& r : results) {
    if (r.outcome == Outcome::kFailed) out += r.name + ": " + r.reason + "\n";
  }
  return out;
}

void expect_all_pass(const Options& options) {
  const std::vector<Result> results = run(options);
  EXPECT_TRUE(conforms(results)) << failures(results);
  EXPECT_GE(results.size(), 20u);
  for (const Result& r : results) {
    const bool may_skip =
        (r.name == "ports_allocate_nothing" && !allocations_are_counted()) ||
        (r.name == "process_dies" && r.reason.find("can step") != std::string::npos);
    EXPECT_TRUE(r.outcome == Outcome::kPassed || may_skip) << r.name << ": " << r.reason;
  }
}

Options simulator(const std::string& library) {
  Options options;
  options.library = library;
  options.config =
      "{robot: robots/mabi_mobile, scene: scenes/kitchen_line.yaml, seed: 1, spawn: random}";
  options.folder = WB_SOURCE_DIR "/config";
  return options;
}

TEST(DriverCheck, TheSimulatorConforms) {
  expect_all_pass(simulator(WB_BUILD_DIR "/drivers/libwb_driver_sim.so"));
  expect_all_pass(simulator(WB_BROKEN_DIR "/libwb_driver_broken_sim_kNone.so"));
}

TEST(DriverCheck, MotorsWithoutDefectConformOnAVirtualClock) { expect_all_pass(motors("kNone")); }

TEST(DriverCheck, MotorsWithoutDefectConformInRealTime) {
  Options options = motors("real_time");
  options.timeout_ms = 400;  // a loaded machine may not write for long
  expect_all_pass(options);
}

struct Case {
  const char* defect;
  const char* check;
  const char* reason;  // part of it
};

void PrintTo(const Case& c, std::ostream* out) { *out << c.defect; }

class DriverCheckFinds : public ::testing::TestWithParam<Case> {};

TEST_P(DriverCheckFinds, TheDefectByNameAndReason) {
  const Case& c = GetParam();
  const bool counted =
      std::string(c.check) != "ports_allocate_nothing" || allocations_are_counted();
  if (!counted) GTEST_SKIP() << "a sanitizer owns malloc";
  const std::vector<Result> results = run(motors(c.defect));
  EXPECT_FALSE(conforms(results));
  for (const Result& r : results) {
    if (r.name == c.check) {
      EXPECT_EQ(r.outcome, Outcome::kFailed);
      EXPECT_NE(r.reason.find(c.reason), std::string::npos) << r.reason;
    } else {
      EXPECT_NE(r.outcome, Outcome::kFailed) << r.name << ": " << r.reason;
    }
  }
}

TEST(DriverCheck, FindsWhatIsWrongWithABrokenSimulator) {
  for (const Case& c :
       {Case{"kStartsByItself", "still_until_written", "between activate and the first write"},
        Case{"kNeverTimesOut", "time_out", "timed_out is not set"},
        Case{"kFrozenPositions", "follows", "has status FOLLOWING, but moved by 0 when"}}) {
    const auto results =
        run(simulator(std::string(WB_BROKEN_DIR "/libwb_driver_broken_sim_") + c.defect + ".so"));
    for (const Result& r : results) {
      EXPECT_EQ(r.outcome == Outcome::kFailed, r.name == c.check)
          << c.defect << ": " << r.name << ": " << r.reason;
      if (r.name != c.check) continue;
      EXPECT_NE(r.reason.find(c.reason), std::string::npos) << r.reason;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Broken, DriverCheckFinds,
    ::testing::Values(
        Case{"kWrongAbi", "interface", "the plugin has ABI 7, this suite checks ABI 1"},
        Case{"kWrongSize", "interface", "the plugin's wb_driver_api has 64 bytes"},
        Case{"kAcceptsGarbage", "garbage_config", "create accepted the configuration"},
        Case{"kRefusesSilently", "garbage_config", "without a log line"},
        Case{"kCrashesOnGarbage", "garbage_config", "crashed: Aborted"},
        Case{"kDuplicateName", "describe", "two of the description's parts are called 'shoulder'"},
        Case{"kNoEffortLimit", "describe", "joint elbow has effort_max 0"},
        Case{"kKnowsEveryExtension", "extensions", "which nobody defines"},
        Case{"kWritesWhileInactive", "states", "write while inactive returned WB_OK"},
        Case{"kMovesAtActivate", "still_until_written", "between activate and the first write"},
        Case{"kIgnoresTimeOut", "time_out", "timed_out is not set"},
        Case{"kTimesOutEarly", "time_out", "before the 100 ms given to activate"},
        Case{"kUnlatchedTimeOut", "time_out", "write after the time-out returned WB_OK"},
        Case{"kUnlatchedStop", "stop", "write after stop returned WB_OK"},
        Case{"kCoastsAfterDeactivate", "deactivate", "joint wheel moved by"},
        Case{"kAcceptsNan", "not_finite", "write accepted nan as position of joint shoulder"},
        Case{"kAcceptsEveryKind", "unsupported_kinds", "write accepted command kind 2 for joint"},
        Case{"kDoesNotClip", "limits", "after a command beyond its"},
        Case{"kDoesNotFollow", "follows", "joint elbow has status FOLLOWING, but moved by 0 when"},
        Case{"kRunsBackwards", "follows", "joint wheel has status FOLLOWING, but moved by -0.05"},
        Case{"kStaleAgeAsFresh", "stamps", "has the age 0 ms, but the newest sample of all is"},
        Case{"kStampGoesBack", "stamps", "t_ns went back"},
        Case{"kUnknownStatus", "status", "joint shoulder has status UNKNOWN"},
        Case{"kQualityInPercent", "status", "has quality 100, allowed 0 to 1"},
        Case{"kAllocatesInRead", "ports_allocate_nothing", "read allocated"},
        Case{"kLogsFromWrite", "ports_do_not_log", "write called the log"},
        Case{"kReleasesTwice", "frames", "accepted the same token twice"},
        Case{"kNanDepth", "frames", "camera camera gave the depth nan"}),
    [](const auto& info) { return std::string(info.param.defect); });

TEST(DriverCheck, ALibraryThatIsNotThereCannotBeRun) {
  EXPECT_THROW(run(motors("no_such_one")), std::runtime_error);
}

TEST(DriverCheck, TheFilesOwnSectionIsReadAndKeptFromThePlugin) {
  const auto file = std::filesystem::path(::testing::TempDir()) /
                    ("driver_check_" + std::to_string(getpid()) + ".yaml");
  std::ofstream(file) << "kind: motors\ncheck: {motion_tolerance: 0.01, timeout_ms: 20}\n";
  const Options options = Options::load("x.so", file);
  EXPECT_EQ(options.motion_tolerance, 0.01);
  EXPECT_EQ(options.timeout_ms, 20);
  EXPECT_EQ(options.config.find("check"), std::string::npos);
  EXPECT_NE(options.config.find("motors"), std::string::npos);
  std::ofstream(file) << "kind: motors\ncheck: {motion_tolerence: 0.01}\n";
  EXPECT_THROW(Options::load("x.so", file), config::ConfigError);
  std::filesystem::remove(file);
}

}  // namespace
}  // namespace wb::check
