// A hub with simulated drives on a thread of its own, for tests of the plugin: what wb-plant is to
// the daemon. Paced or in real time.
#pragma once
#include <atomic>
#include <ctime>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "drivers/can/node/cia402_node.hpp"
#include "drivers/can/socket_bus.hpp"

namespace wb::can {

// What one of the drives does wrong.
struct BrokenDrive {
  int drive = -1;  // index
  NodeFaults faults{};
  double creep_radps = 0;  // moves by itself, under power and without
  bool heartbeat_consumer = true;
};

// A joint that slips at a constant speed, held or not.
class CreepingModel final : public DriveModel {
 public:
  CreepingModel(double position, double creep_radps) : joint_(position), creep_(creep_radps) {}
  double position() const noexcept override { return joint_.position() + crept_; }
  double velocity() const noexcept override { return joint_.velocity() + creep_; }
  double torque() const noexcept override { return joint_.torque(); }
  void apply(DriveAction action, double target) noexcept override {
    if (action != DriveAction::kPosition) held_ = crept_;
    joint_.apply(action, action == DriveAction::kPosition ? target - held_ : target);
  }
  void step(double dt_s) noexcept override {
    joint_.step(dt_s);
    crept_ += creep_ * dt_s;
  }

 private:
  IntegratorModel joint_;
  double creep_, crept_ = 0;
  double held_ = 0;  // of it, before the servo held the joint
};

class NodeHub {
 public:
  // drives: node ids 1, 2, ...; joints of the default scale, standing at 0.1 rad each.
  NodeHub(const std::filesystem::path& path, bool paced, int drives, const BrokenDrive& broken = {})
      : hub_(path, paced), models_(static_cast<std::size_t>(drives)) {
    for (int i = 0; i < drives; ++i) {
      auto& model = models_[static_cast<std::size_t>(i)];
      model = std::make_unique<CreepingModel>(0.1, i == broken.drive ? broken.creep_radps : 0);
      NodeOptions options;
      options.node_id = i + 1;
      options.heartbeat_consumer = i != broken.drive || broken.heartbeat_consumer;
      nodes_.push_back(std::make_unique<Cia402Node>(options, hub_.bus(), *model));
      if (i == broken.drive) nodes_.back()->faults() = broken.faults;
    }
    thread_ = std::thread([this] { run(); });
  }
  ~NodeHub() {
    ends_ = true;
    thread_.join();
  }
  // Whether drive i was enabled when the bus last stood still.
  bool enabled(int i) const { return (enabled_.load() >> i & 1) != 0; }

 private:
  void run() {
    while (!ends_) {
      if (hub_.paced()) {
        const auto tick = hub_.requested_tick(5);
        if (!tick) continue;
        hub_.bus().advance(tick->bus_ns);
        note();
        hub_.finish_tick();
      } else {
        timespec t;
        clock_gettime(CLOCK_MONOTONIC, &t);
        hub_.pump(static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec);
        note();
        const timespec wait{0, 500'000};
        nanosleep(&wait, nullptr);
      }
    }
  }
  void note() {
    unsigned mask = 0;
    for (std::size_t i = 0; i < nodes_.size(); ++i) mask |= unsigned{nodes_[i]->enabled()} << i;
    enabled_ = mask;
  }

  SocketBus hub_;
  std::vector<std::unique_ptr<DriveModel>> models_;
  std::vector<std::unique_ptr<Cia402Node>> nodes_;
  std::atomic<unsigned> enabled_{0};
  std::atomic<bool> ends_{false};
  std::thread thread_;
};

// The plugin's section for such a hub: three csp joints and a csv wheel.
inline std::string hub_config(const std::filesystem::path& path, bool paced,
                              const std::string& supervision = "") {
  std::string text = "sync_rate_hz: " + std::string(paced ? "400" : "100") + "\n" + supervision +
                     "buses: [{name: arm, type: unix, path: '" + path.string() +
                     "', bit_rate: 1000000, paced: " + (paced ? "true" : "false") + "}]\ndrives:\n";
  for (int i = 1; i <= 4; ++i) {
    text +=
        "  - {joint: j" + std::to_string(i) + ", bus: arm, node: " + std::to_string(i) +
        ", counts_per_rad: 100000, torque_per_permille_nm: 0.1, velocity_max_radps: 2, "
        "effort_max_nm: 20, vendor: 0x5742, product: 0x402, " +
        (i < 4 ? "mode: csp, position_min_rad: -2, position_max_rad: 2, following_max_rad: 0.1}\n"
               : "mode: csv, wheel: true, following_max_radps: 0.5}\n");
  }
  return text;
}

}  // namespace wb::can
