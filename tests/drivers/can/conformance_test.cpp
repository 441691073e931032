// The conformance suite of the driver ABI (drivers/check) on the CAN plugin, against simulated
// drives on a paced bus.
#include <gtest/gtest.h>
#include <unistd.h>

#include "drivers/check/driver_check.hpp"
#include "tests/drivers/can/node_hub.hpp"

namespace wb::can {
namespace {

TEST(CanPlugin, PassesTheConformanceSuite) {
  const auto path =
      std::filesystem::temp_directory_path() / ("wb_can_check_" + std::to_string(::getpid()));
  NodeHub hub(path, true, 4);
  check::Options options;
  options.library = WB_BUILD_DIR "/drivers/libwb_driver_can.so";
  options.config = hub_config(path, true);
  options.folder = "/";
  const auto results = check::run(options);
  EXPECT_GE(results.size(), 15u);
  for (const check::Result& r : results) {
    EXPECT_NE(r.outcome, check::Outcome::kFailed) << r.name << ": " << r.reason;
    if (r.outcome == check::Outcome::kSkipped)
      std::printf("skipped: %s: %s\n", r.name.c_str(), r.reason.c_str());
  }
}

}  // namespace
}  // namespace wb::can
