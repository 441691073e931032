// wb-plant as a child process, and the daemon's configuration that goes with it: the project's own
// files, with sockets, DDS domain and spawn of this test. Each test process has a domain, a
// discovery tag and a folder of its own.
#pragma once
#include <gtest/gtest.h>

#include <memory>
#include <regex>

#include "tests/daemon/process.hpp"
#include "tests/dds_domain.hpp"

namespace wb::test {

struct PlantOptions {
  bool can = true;           // false: DDS alone
  std::string mode = "csp";  // of the arm's drives
  bool paced = true;         // false: real time
  bool gripper = false;      // behind a simulated Robotiq, at gripper_port()
  std::string spawn = "random";
  int seed = 1;
};

// A robot's drives do not wait for what else runs on the robot's computer.
inline constexpr int kPlantPriority = 85;

class PlantTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override {
    plant_.reset();
    fs::remove_all(folder_);
  }

  // Writes both files and starts the plant; returns when it is there, or has ended.
  void start_plant(const PlantOptions& o) {
    const std::string kind = o.can ? "can" : "dds";
    write("daemon.yaml", adapt(contents(config_ / ("wholebodyd_" + kind + ".yaml")), o));
    std::string plant = adapt(contents(config_ / ("plant_" + kind + ".yaml")), o);
    replace(plant, "can: .*\\.yaml.*", "can: daemon.yaml");
    if (o.gripper) plant += "gripper: {port: gripper, opening_max_m: 0.08}\n";
    write("plant.yaml", plant);
    plant_ = std::make_unique<Process>(
        std::vector<std::string>{WB_PLANT, "--config", folder_ / "plant.yaml", "--journal",
                                 folder_ / "journal.csv"},
        folder_ / "plant", o.paced ? 0 : kPlantPriority);
    while (!plant_->ended() && plant_said().find("wb-plant: sim") == std::string::npos)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  fs::path daemon_file() const { return folder_ / "daemon.yaml"; }
  fs::path gripper_port() const { return folder_ / "gripper"; }
  Process& plant() { return *plant_; }
  std::string plant_said() const { return contents(folder_ / "plant.err"); }

  const int domain_ = own_dds_domain();
  const fs::path folder_ =
      fs::path(::testing::TempDir()) / ("wb_plant_" + std::to_string(getpid()));

 private:
  static void replace(std::string& text, const std::string& from, const std::string& to) {
    const std::string changed = std::regex_replace(text, std::regex(from), to);
    text = changed;
  }
  std::string adapt(std::string text, const PlantOptions& o) const {
    replace(text, "(robots|scenes)/", config_.string() + "/$1/");
    replace(text, "/tmp/wholebody_", folder_.string() + "/");
    replace(text, "domain: 0", "domain: " + std::to_string(domain_));
    replace(text, "mode: csp", "mode: " + o.mode);
    replace(text, "seed: 1", "seed: " + std::to_string(o.seed));
    replace(text, "spawn: random", "spawn: " + o.spawn);
    if (!o.paced) {
      replace(text, "paced: true", "paced: false");
      replace(text, "clock: paced", "clock: ros");
      // Half the rate: the hub is a process like others, and a bus's window ends at 0.8 of a
      // period.
      replace(text, "sync_rate_hz: 400", "sync_rate_hz: 200");
      replace(text, ", latency_ms: [0-9]+", "");
      replace(text, "(type: unix.*paced: false)", "$1, priority: 75");
    }
    return text;
  }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
  }

  const fs::path config_ = WB_SOURCE_DIR "/config";
  std::unique_ptr<Process> plant_;
};

}  // namespace wb::test
