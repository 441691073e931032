// Facts about wholebodyd as a process, commanded by wbctl as another: a drawer opens, streams of
// plan and truth go out, the recording replays, requests and configurations that make no sense are
// refused with a reason. Every wait is bounded.
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "daemon/service/dds.hpp"
#include "tests/daemon/process.hpp"
#include "tests/daemon/service_fixture.hpp"

namespace wb {
namespace {

namespace fs = std::filesystem;
using test::contents;
using test::Process;

// Bounds that only a failure reaches: a run takes half a minute on a slow machine, everything else
// seconds.
constexpr double kRunS = 200, kEndS = Process::kEndS;

class Daemon : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  Process daemon(std::vector<std::string> arguments,
                 const std::string& config = WB_SOURCE_DIR "/config/wholebodyd.yaml") {
    arguments.insert(arguments.begin(), {WB_WHOLEBODYD, "--config", config});
    return Process(std::move(arguments), folder_ / "wholebodyd");
  }
  Process wbctl(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), WB_WBCTL);
    return Process(std::move(arguments), folder_ / "wbctl");
  }
  // Starts on a configuration in which `from` is replaced by `to`; the message on stderr, with the
  // exit code.
  std::pair<int, std::string> start_with(const std::string& from, const std::string& to) {
    std::string text = contents(WB_SOURCE_DIR "/config/wholebodyd.yaml");
    for (const std::string folder : {"robots/", "scenes/"}) {
      for (std::size_t at = 0; (at = text.find(folder, at)) != std::string::npos;
           at += folder.size() + sizeof WB_SOURCE_DIR "/config") {
        text.insert(at, WB_SOURCE_DIR "/config/");
      }
    }
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    const fs::path file = folder_ / "changed.yaml";
    std::ofstream(file) << text;
    Process process = daemon({"--lockstep"}, file);
    const int code = process.exit_code();
    return {code, contents(process.err())};
  }

  const int domain_ = test::own_dds_domain();
  const fs::path folder_ =
      fs::path(::testing::TempDir()) / ("wb_daemon_" + std::to_string(getpid()));
};

TEST_F(Daemon, OpensADrawerInLockstepStreamsPlanAndTruthAndReplaysEqual) {
  const fs::path recording = folder_ / "run.rec";
  Process running = daemon({"--lockstep", "--free-running", "--truth", "--record", recording,
                            "--observe", folder_, "--object", "drawer_1"});
  const dds::Entity participant = dds::make_participant(domain_, "watcher");
  dds::Reader<dds::msg::Path> plans(participant, "rt/plan", dds::kStreamProfile);
  dds::Reader<dds::msg::Float64> truths(participant, "rt/truth/drawer_1", dds::kStreamProfile);
  dds::Reader<dds::msg::Status> statuses(participant, "rt/wholebody/status", dds::kStreamProfile);

  Process reset = wbctl({"reset", "--timeout_s", "30"});
  ASSERT_EQ(reset.exit_code(2 * kEndS), 0) << contents(running.err());
  Process open = wbctl({"open", "drawer_1", "--timeout_s", "30"});
  int plan_count = 0;
  std::uint32_t plan_poses = 0;
  double truth_m = -1, hand_x_min = 1e9, hand_x_max = -1e9;
  std::string object;
  ASSERT_TRUE(wait_until(
      [&] {
        plans.take([&](const dds::msg::Path& plan) {
          ++plan_count;
          plan_poses = std::max(plan_poses, plan.poses_._length);
          for (std::uint32_t i = 0; i < plan.poses_._length; ++i) {
            const double x = plan.poses_._buffer[i].pose_.position_.x_;
            hand_x_min = std::min(hand_x_min, x);
            hand_x_max = std::max(hand_x_max, x);
          }
        });
        truths.take([&](const dds::msg::Float64& value) { truth_m = value.data_; });
        statuses.take([&](const dds::msg::Status& s) { object = s.object_; });
        return open.ended();
      },
      kRunS));
  EXPECT_EQ(open.exit_code(), 0) << contents(open.err());
  EXPECT_EQ(object, "drawer_1");
  EXPECT_GT(plan_count, 0);
  EXPECT_GT(plan_poses, 1u);
  // Within the kitchen of 5 x 5 m, in odometry coordinates whose origin is somewhere in it; and it
  // goes somewhere.
  EXPECT_LT(std::max(std::abs(hand_x_min), std::abs(hand_x_max)), 8.0);
  EXPECT_GT(hand_x_max - hand_x_min, 0.5);
  // The last sample is at most two publications (0.2 s) older than the end, when the drawer stands
  // open.
  EXPECT_GT(truth_m, 0.65 * 0.45);

  Process nothing = wbctl({"open", "nothing_1", "--json"});
  EXPECT_EQ(nothing.exit_code(), 1);
  const YAML::Node refusal = YAML::Load(contents(nothing.out()));
  EXPECT_EQ(refusal["outcome"].as<std::string>(), "refused");
  EXPECT_NE(refusal["reason"].as<std::string>(), "");

  EXPECT_EQ(running.terminate(), 0) << contents(running.err());
  EXPECT_EQ(contents(running.out()).rfind("opened drawer_1: ", 0), 0u) << contents(running.out());
  EXPECT_NE(contents(running.err()).find("truth: drawer_1 at 0.4"), std::string::npos)
      << contents(running.err());
  const YAML::Node summary = YAML::LoadFile(folder_ / "summary.json");
  EXPECT_TRUE(summary["opened"].as<bool>());
  for (const char* picture : {"start.ppm", "grasp.ppm", "hand.ppm", "open.ppm"}) {
    EXPECT_TRUE(fs::exists(folder_ / picture)) << picture;
  }

  Process replay = wbctl({"replay", recording, "--json"});
  EXPECT_EQ(replay.exit_code(kRunS), 0) << contents(replay.out()) << contents(replay.err());
  EXPECT_TRUE(YAML::Load(contents(replay.out()))["equal"].as<bool>());
}

TEST_F(Daemon, StampsInRealTimeAreRosTime) {
  Process running = daemon({}, WB_SOURCE_DIR "/config/wholebodyd_real_time.yaml");
  const dds::Entity participant = dds::make_participant(domain_, "watcher");
  dds::Reader<dds::msg::JointState> states(participant, "rt/joint_states", dds::kStreamProfile);
  std::int64_t behind_ns = 0;
  bool seen = false;
  ASSERT_TRUE(wait_until(
      [&] {
        states.take([&](const dds::msg::JointState& s) {
          behind_ns = ros_now_ns() - (std::int64_t{s.header_.stamp_.sec_} * kNanosPerSecond +
                                      s.header_.stamp_.nanosec_);
          seen = true;
        });
        return seen || running.ended();
      },
      kEndS));
  // An offset taken against another epoch is wrong by the machine's uptime or by decades, a slow
  // delivery by less than this.
  EXPECT_LT(std::abs(behind_ns), 5 * kNanosPerSecond) << contents(running.err());
  EXPECT_EQ(running.terminate(), 0) << contents(running.err());
}

TEST_F(Daemon, StatusShowsTheDriversCountersUnderTheirNames) {
  Process running = daemon({}, WB_SOURCE_DIR "/config/wholebodyd_real_time.yaml");
  Process status = wbctl({"status", "--json", "--timeout_s", "30"});
  ASSERT_EQ(status.exit_code(2 * kEndS), 0) << contents(status.err()) << contents(running.err());
  const YAML::Node counters = YAML::Load(contents(status.out()))["counters"];
  for (const char* name : {"sim.failed_reads", "sim.failed_writes", "sim.joint_faults"}) {
    ASSERT_TRUE(counters[name]) << name << " in " << contents(status.out());
    EXPECT_EQ(counters[name].as<int>(), 0) << name;
  }
  EXPECT_EQ(running.terminate(), 0) << contents(running.err());
}

TEST_F(Daemon, RefusesAMissingConfigurationFile) {
  Process process = daemon({"--lockstep"}, "/nowhere/wholebodyd.yaml");
  EXPECT_EQ(process.exit_code(), 1);
  EXPECT_NE(contents(process.err()).find("/nowhere/wholebodyd.yaml"), std::string::npos)
      << contents(process.err());
}

TEST_F(Daemon, RefusesAnUnknownKeyByNameAndLine) {
  const auto [code, message] = start_with("seed: 1", "seed: 1\ncolour: red");
  EXPECT_EQ(code, 1);
  EXPECT_NE(message.find("changed.yaml:5: unknown key 'colour'"), std::string::npos) << message;
}

TEST_F(Daemon, RefusesAMissingPluginByName) {
  const auto [code, message] = start_with("libwb_driver_sim.so", "libwb_driver_none.so");
  EXPECT_EQ(code, 1);
  EXPECT_NE(message.find("libwb_driver_none.so"), std::string::npos) << message;
}

TEST_F(Daemon, RefusesANetworkThatDoesNotExist) {
  setenv("CYCLONEDDS_URI",
         "<CycloneDDS><Domain><General><Interfaces><NetworkInterface "
         "name=\"none0\"/></Interfaces></General></Domain></CycloneDDS>",
         1);
  Process process = daemon({"--lockstep"});
  EXPECT_EQ(process.exit_code(), 1);
  EXPECT_NE(contents(process.err()).find("CYCLONEDDS_URI"), std::string::npos)
      << contents(process.err());
}

TEST_F(Daemon, RefusesWrongUsageWithOne) {
  EXPECT_EQ(Process({WB_WHOLEBODYD}, folder_ / "usage").exit_code(), 1);
  EXPECT_EQ(daemon({"--free-running"}).exit_code(), 1) << "only with --lockstep";
  EXPECT_EQ(daemon({"--lockstep", "--observe", folder_}).exit_code(), 1) << "only with --object";
}

}  // namespace
}  // namespace wb
