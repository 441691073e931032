// One side of the protocol as a process of its own, for tests that kill it:
//   dds_robot_process robot DOMAIN      a fake robot behind the low-level side, until killed
//   dds_robot_process paced DOMAIN [DEFECT]  a paced one with a camera, sound or with FakeRobot's
//                                       ignores_stop or moves_by_itself, until killed
//   dds_robot_process commander DOMAIN  the plugin, active, commanding 0.2 rad/s, until killed
// Says "ready" when it is (robot: at once; commander: when the joints move).
#include "tests/drivers/dds/dds_fixture.hpp"
#include "tests/drivers/dds/seeing_robot.hpp"

namespace wb::dds {
namespace {

void say_ready() {
  std::puts("ready");
  std::fflush(stdout);
}

void robot(int domain) {
  LowLevelOptions options;
  options.domain = domain;
  options.command_memory_ns = 2 * kNanosPerSecond;
  FakeRobot robot(fake_description(), false);
  LowLevel low_level(options, fake_description(), robot);
  say_ready();
  for (;;) low_level.spin(5'000'000);
}

void paced(int domain, const std::string& defect) {
  LowLevelOptions options;
  options.domain = domain;
  options.paced = true;
  options.cameras = {SeeingRobot::camera()};
  // Wall clock, and a loaded machine may let nobody run for a while; hosts release their leases.
  options.lease_silence_ns = 10 * kNanosPerSecond;
  options.command_wait_ns = 20 * kNanosPerSecond;
  SeeingRobot robot;
  robot.ignores_stop = defect == "ignores_stop";
  robot.moves_by_itself = defect == "moves_by_itself";
  LowLevel low_level(options, fake_description(), robot);
  robot.low_level = &low_level;
  say_ready();
  for (;;) low_level.spin(5'000'000);
}

void commander(int domain) {
  Plugin plugin("{domain: " + std::to_string(domain) +
                ", prefix: robot, clock: ros, joints: all, sample_memory_ms: 400, silence_ms: "
                "1000}");
  if (plugin.activate(300'000'000) != WB_OK) throw std::runtime_error(plugin.log());
  bool said = false;
  for (;;) {
    plugin.write(velocity_commands(5, 0.2));
    if (!said && plugin.read() == WB_OK && plugin.readings.joints[0].position > 0) {
      say_ready();
      said = true;
    }
    sleep_s(0.005);
  }
}

}  // namespace
}  // namespace wb::dds

int main(int argc, char** argv) {
  if (argc != 3 && argc != 4) return 2;
  const int domain = std::atoi(argv[2]);
  try {
    if (std::strcmp(argv[1], "robot") == 0) wb::dds::robot(domain);
    if (std::strcmp(argv[1], "paced") == 0) wb::dds::paced(domain, argc == 4 ? argv[3] : "");
    if (std::strcmp(argv[1], "commander") == 0) wb::dds::commander(domain);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  return 1;
}
