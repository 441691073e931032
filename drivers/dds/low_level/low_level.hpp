// The low-level computer's side of drivers/dds: publishes measurements, grants the lease, checks
// commands, clips them to the joints' limits, and stops the joints when commands cease. Serves
// tests and any robot behind LowLevelRobot. World: job; everything is called by one thread, the one
// that calls spin(), which is also the one that calls the robot. Protocol: docs/how-to/dds.md.
#pragma once
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/types/time.hpp"
#include "drivers/driver.h"
#include "drivers/sim/truth.h"

namespace wb::dds {

// The robot behind the protocol, in the types of the driver ABI. Times: the robot's own clock from
// 0 if it is paced, else CLOCK_REALTIME (ROS time).
struct LowLevelRobot {
  virtual ~LowLevelRobot() = default;
  // The newest measurements; ages as of readings.t_ns. A joint's status may be left
  // WB_JOINT_UNKNOWN: then the low-level side derives it from error_code and from what it does
  // itself.
  virtual void read(wb_readings& readings) = 0;
  // A new lease: the time-out actions of its holder, one for each joint. Nothing moves yet.
  virtual void begin(const wb_timeout_action* actions) {}
  // A command of the lease's holder: finite, of a kind that the joint takes, within its limits.
  virtual void apply(const wb_commands& commands) = 0;
  // Time-out action now, one for each joint. The next apply() belongs to another lease.
  virtual void stop(const wb_timeout_action* actions) = 0;
  // Paced robots: goes on to t, publishing truth and frames that are due on the way. False: broken.
  virtual bool advance(TimeNs t) { return true; }
};

struct LowLevelCamera {
  std::string name;   // optical frame
  std::string topic;  // of its Image; CameraInfo is on <topic's folder>/camera_info
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // our convention: the centre of pixel (u, v) is at + 0.5
};

struct LowLevelOptions {
  int domain = 0;
  std::string prefix = "robot";
  bool paced = false;
  TimeNs period_ns = 2'500'000;            // of measurements; not paced
  TimeNs lease_silence_ns = 500'000'000;   // wall clock
  TimeNs command_memory_ns = 100'000'000;  // older commands are refused; not paced
  TimeNs command_wait_ns = 200'000'000;    // paced: longest wait for the command that a tick names
  std::vector<std::uint32_t> timeout_actions;  // bits 1 << action, for each joint; empty: all
  std::vector<LowLevelCamera> cameras;
};

// What a test may break; any thread.
struct LowLevelFaults {
  std::atomic<bool> silent{false};         // publishes no measurements
  std::atomic<bool> old_stamps{false};     // a second in the past
  std::atomic<bool> future_stamps{false};  // 50 ms ahead
  std::atomic<bool> duplicate{false};      // every measurement twice
  std::atomic<bool> reorder{false};        // in pairs, newer first
  std::atomic<bool> frozen{false};         // the same measurement under new sequence numbers
  std::atomic<bool> deaf{false};           // answers no lease request
};

// Counts since the start; any thread.
struct LowLevelCounts {
  std::atomic<std::uint64_t> measurements{0}, commands{0}, refused_commands{0}, time_outs{0},
      leases{0}, refused_leases{0}, ticks{0}, refused_ticks{0};
};

class LowLevel {
 public:
  // description: joints, parts and name of the robot (cameras: options). Throws
  // config::ConfigError.
  LowLevel(const LowLevelOptions& options, const wb_description& description, LowLevelRobot& robot);
  ~LowLevel();

  // Handles what has come and what is due, and waits for the next, at most timeout_ns.
  void spin(TimeNs timeout_ns);

  // A depth image [m, row-major, +inf or NaN: no return] of camera `index` of the options; t_ns: on
  // the robot's clock. Called by the robot in advance(), or between calls of spin().
  void publish_depth(int index, TimeNs t_ns, const float* depth);
  // The simulated world's truth, likewise.
  struct Truth {
    TimeNs t_ns = 0;
    wb_sim_pose base_pose{}, spawn_pose{};
    struct Object {
      wb_sim_object object{};
      wb_sim_pose X_GE{};
      double clearance = 0;  // NaN: not measured
    };
    std::vector<Object> objects;           // at most 32
    std::vector<wb_sim_contact> contacts;  // the first 64 travel
    std::uint32_t contact_count = 0;
    std::vector<std::pair<std::string, wb_sim_pose>> links;  // at most 64
    double clearance = 0;
    std::uint64_t frames_dropped = 0;
  };
  void publish_truth(const Truth& truth);

  LowLevelFaults faults;
  const LowLevelCounts& counts() const { return counts_; }

 private:
  struct Impl;
  LowLevelCounts counts_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace wb::dds
