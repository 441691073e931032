// The conformance suite of the driver ABI (drivers/check) on the DDS plugin, against a paced
// low-level computer in a process of its own: a sound one passes, and a robot that does not do what
// it is told fails the checks that are there for it.
#include "core/rt/allocation_count.hpp"
#include "tests/drivers/check_results.hpp"
#include "tests/drivers/dds/child.hpp"
#include "tests/drivers/dds/dds_fixture.hpp"
#include "tests/drivers/dds/seeing_robot.hpp"

namespace wb::dds {
namespace {

using check::expect_failed;
using check::Outcome;
using check::Result;

class DdsConformance : public DdsDriverTest {
 protected:
  // The suite forks; this process itself never touches DDS.
  static std::vector<Result> suite_against(const std::string& defect) {
    Child robot({WB_ROBOT_PROCESS, "paced", std::to_string(domain()), defect});
    if (robot.line() != "ready") throw std::runtime_error("the robot did not start");
    check::Options options;
    options.library = WB_BUILD_DIR "/drivers/libwb_driver_dds.so";
    options.config =
        config(true, std::string(SeeingRobot::kConfig) + ", connect_timeout_ms: 60000");
    options.folder = "/";
    const auto results = check::run(options);
    for (const Result& r : results) std::printf("%s: %s\n", r.name.c_str(), r.reason.c_str());
    return results;
  }
};

TEST_F(DdsConformance, ASoundRobotPassesEveryCheck) {
  const auto results = suite_against("");
  EXPECT_GE(results.size(), 20u);
  for (const Result& r : results) {
    const bool may_skip = r.name == "process_dies" ||  // a paced robot stands when its host is dead
                          (r.name == "ports_allocate_nothing" && !allocations_are_counted());
    EXPECT_TRUE(r.outcome == Outcome::kPassed || may_skip) << r.name << ": " << r.reason;
  }
}

TEST_F(DdsConformance, ARobotThatIgnoresStopIsFoundAlthoughItSaysThatItStopped) {
  const auto results = suite_against("ignores_stop");
  expect_failed(results, "time_out", "joint wheel_0 moved by");
  expect_failed(results, "time_out", "after the time-out, while commands were written");
  expect_failed(results, "stop", "after stop, while commands were written");
  expect_failed(results, "deactivate", "after deactivate");
  EXPECT_EQ(check::failed(results), (std::vector<std::string>{"time_out", "stop", "deactivate"}));
}

TEST_F(DdsConformance, ARobotThatMovesByItselfIsFoundBeforeTheFirstWrite) {
  const auto results = suite_against("moves_by_itself");
  expect_failed(results, "still_until_written", "between activate and the first write");
}

}  // namespace
}  // namespace wb::dds
