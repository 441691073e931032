// The forearm avoids a neighbour's open door: the upper door of a fridge beside drawer_1, hinged on
// the drawer's side, stands open so that it leans over the way of the arm. What the environment
// term is worth there.
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <iterator>

#include "tests/scenario/run.hpp"

namespace wb {
namespace {

using test::SimulatedRun;

constexpr double kDoor_rad = 1.6;  // 2 degrees beyond square to the front
constexpr std::uint64_t kSeeds[] = {2000, 2001, 2002};

// The kitchen, its fridge with a door from 0.9 m upwards (drawer_1 ends at 0.85 m) that is hinged
// on the right.
class Kitchen {
 public:
  Kitchen() {
    std::ifstream in(WB_SOURCE_DIR "/config/scenes/kitchen_line.yaml");
    std::string text(std::istreambuf_iterator<char>(in), {});
    const std::string door = "name: fridge_1\n        hinge: left\n        bottom_m: 0.07\n";
    const std::size_t at = text.find(door);
    if (at == std::string::npos) throw std::runtime_error("the kitchen's fridge has changed");
    text.replace(at, door.size(), "name: fridge_1\n        hinge: right\n        bottom_m: 0.9\n");
    std::ofstream(file_) << text;
  }
  ~Kitchen() { std::filesystem::remove(file_); }
  const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_ = std::filesystem::temp_directory_path() /
                                ("wb_open_door_" + std::to_string(getpid()) + ".yaml");
};

struct Outcome {
  bool opened = false;
  std::uint32_t contacts = 0;
  double least_m = 1e9;  // of the arm from the door
  std::string names;
};

Outcome open_drawer(std::uint64_t seed, const std::vector<std::string>& disabled_terms) {
  const Kitchen kitchen;
  // From here the base's cameras see the door, which they do not from right below it.
  SimulatedRun run({.seed = seed,
                    .spawn = "{x_m: -0.9, y_m: 0.2, yaw_rad: 0.3}",
                    .scene = kitchen.file(),
                    .disabled_terms = disabled_terms});
  run.fault().set_object(run.driver(), run.object_index("fridge_1"), kDoor_rad);
  run.reset();
  const std::uint64_t id = run.open("drawer_1");
  Outcome out;
  while (!run.ended(id)) {
    run.run_for(0.05);
    out.least_m = std::min(out.least_m, run.arm_clearance("fridge_1"));
  }
  out.opened = run.outcome(id) == RequestOutcome::kSucceeded;
  out.contacts = run.contacts();
  out.names = run.contact_names();
  return out;
}

TEST(OpenDoor, ForearmAvoidsItWhileADrawerBesideItIsOpened) {
  for (const std::uint64_t seed : kSeeds) {
    const Outcome with = open_drawer(seed, {});
    EXPECT_TRUE(with.opened) << "seed " << seed;
    EXPECT_EQ(with.contacts, 0u) << "seed " << seed << ": " << with.names;
    RecordProperty("least_mm_" + std::to_string(seed), static_cast<int>(1e3 * with.least_m));
  }
}

// Otherwise the door would not have been in the way. Nearer: by more than the 25 mm within which
// the spheres cover the arm.
TEST(OpenDoor, WithoutTheEnvironmentTermItIsHitOrTheArmComesNearer) {
  for (const std::uint64_t seed : kSeeds) {
    const Outcome with = open_drawer(seed, {}), without = open_drawer(seed, {"environment"});
    EXPECT_TRUE(without.contacts > 0 || without.least_m < with.least_m - 0.025)
        << "seed " << seed << ": " << with.least_m << " m with the term, " << without.least_m
        << " m without";
  }
}

}  // namespace
}  // namespace wb
