// The drawer opens on a robot in another process: CiA 402 drives in position and in torque mode,
// and a low-level computer that speaks DDS; in virtual time that the bus paces.
#include "drivers/plugin.hpp"
#include "tests/scenario/plant_fixture.hpp"
#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::PlantOptions;
using test::SimulatedRun;

class Plant : public test::PlantTest {
 protected:
  void opens_the_drawer(PlantOptions options) {
    options.seed = 3000;  // nothing was tuned on it
    start_plant(options);
    SimulatedRun run(
        SimulatedRun::Configured{DaemonConfig::load(daemon_file(), WB_BUILD_DIR "/drivers")});
    // A drive's enabling takes ticks; a reset is refused until all of them answer.
    ASSERT_TRUE(run.run_to_end(run.reset(), 5)) << plant_said();
    const std::uint64_t id = run.open("drawer_1");
    EXPECT_TRUE(run.run_to_end(id, 60)) << run.status(id).reason.view() << "; " << plant_said();
    const wb_sim_object drawer = run.object("drawer_1");
    std::printf("drawer_1 at %.3f of %.3f m after %.1f s, %u collisions %s\n", drawer.value,
                drawer.range, to_seconds(run.now()), run.contacts(), run.contact_names().c_str());
    EXPECT_GT(drawer.value, 0.65 * drawer.range);
    EXPECT_EQ(run.contacts(), 0u) << run.contact_names();
    EXPECT_FALSE(plant().ended()) << plant_said();
    EXPECT_EQ(plant().terminate(), 0) << plant_said();
  }
};

TEST_F(Plant, DrawerOpensOverCanWithPositionDrives) { opens_the_drawer({.mode = "csp"}); }

TEST_F(Plant, DrawerOpensOverCanWithTorqueDrives) { opens_the_drawer({.mode = "cst"}); }

TEST_F(Plant, DrawerOpensOverDds) { opens_the_drawer({.can = false}); }

TEST_F(Plant, FingersFollowTheRobotiqPlugin) {
  start_plant({.can = false, .paced = false, .gripper = true});
  const std::string config =
      "{device: " + gripper_port().string() + ", opening_max_m: 0.08, silence_max_ms: 5000}";
  wb::Plugin gripper(
      {WB_BUILD_DIR "/drivers/libwb_driver_robotiq.so", config, "/"}, "robotiq",
      [](void*, wb_log_level, const char* text) { std::fprintf(stderr, "%s\n", text); }, nullptr);
  const wb_driver_api& api = gripper.api();
  constexpr std::int64_t kTimeout_ns = 5'000'000'000;
  ASSERT_EQ(api.activate(gripper.get(), kTimeout_ns, nullptr), WB_OK);
  // What is read is where the plant's fingers are: the stand-in for the gripper moves none itself.
  for (const double opening_m : {0.02, 0.06}) {
    wb_commands commands{};
    commands.gripper = {opening_m, 40};
    wb_readings readings{};
    EXPECT_TRUE(test::wait_until([&] {
      EXPECT_EQ(api.write(gripper.get(), &commands), WB_OK);
      return api.read(gripper.get(), &readings) == WB_OK && readings.gripper.valid &&
             std::abs(readings.gripper.opening - opening_m) < 0.002;
    })) << readings.gripper.opening
        << "; " << plant_said();
  }
}

TEST_F(Plant, WrongConfigurationIsNamedAndEndsTheProcess) {
  start_plant({.mode = "cps"});
  EXPECT_EQ(plant().exit_code(), 1);
  EXPECT_NE(plant_said().find("cps"), std::string::npos) << plant_said();
}

}  // namespace
}  // namespace wb
