// A Robotiq 2F-85 as its serial line shows it: a Modbus RTU server, written from the protocol's
// description without the library that the driver uses, on a pseudo-terminal; for tests and
// wb-plant. Its thread serves the line and moves the fingers; everything public is for any other
// thread. Source: Modbus over serial line V1.02; register map: registers.hpp.
#pragma once
#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "drivers/robotiq/registers.hpp"

namespace wb::robotiq {

// The fingers' mechanics: told what the gripper wants of them since dt_s, says where they are.
struct FingerOrder {
  double opening_m = 0, speed_mps = 0, force_n = 0;
  bool move = false;  // false: stand still
};
struct Fingers {
  double opening_m = 0;
  bool blocked = false;  // by something, at less than the force
};
using Mechanics = std::function<Fingers(const FingerOrder&, double dt_s)>;

// Fingers that move at the ordered speed and stop at an object of this width (0: none).
Mechanics fingers_around(const std::atomic<double>& object_m, double opening_max_m);

class SimulatedGripper {
 public:
  // `port` becomes a link to the pseudo-terminal, anew each time the gripper is plugged in. Throws
  // std::runtime_error.
  SimulatedGripper(std::filesystem::path port, Stroke stroke, Mechanics mechanics);
  ~SimulatedGripper();

  // Faults.
  void unplug();
  void plug_in();
  void power_cycle() { power_cycles_ = true; }  // silent for a while, and without its activation
  void be_silent(bool on) { silent_ = on; }
  void spoil_answers(int count) { spoilt_ = count; }  // checksums of the next ones
  void fault(std::uint8_t code) { fault_ = code; }    // until the gripper is reset

  Order order() const;  // the registers that the driver has written
  Status status() const;
  int activations() const { return activations_; }  // begun so far
  std::uint64_t requests() const { return requests_; }

 private:
  using Bytes = std::vector<std::uint8_t>;
  void open();
  void close();
  void run();
  void serve();
  Bytes answer(const Bytes& request);
  void move(double dt_s);

  std::filesystem::path port_;
  Stroke stroke_;
  Mechanics mechanics_;
  std::atomic<bool> stopping_{false}, silent_{false}, power_cycles_{false}, plugged_{true};
  std::atomic<int> spoilt_{0}, activations_{0};
  std::atomic<std::uint8_t> fault_{0};
  std::atomic<std::uint64_t> requests_{0};
  mutable std::mutex mutex_;  // registers
  Registers written_{};
  Status status_;
  // The thread's own.
  int master_ = -1;
  Bytes received_;
  std::chrono::steady_clock::time_point heard_;  // its newest bytes
  int starting_ = 0;
  double activating_s_ = 0;
  std::thread thread_;
};

}  // namespace wb::robotiq
