// Both ends of a SocketCAN bus in one program: simulated CiA 402 drives on one interface of a vxcan
// pair, the CAN plugin on the other, each in real time on threads of its own. Runs in the guest
// that tests/vm/run boots; this machine may have no CAN at all.
#pragma once
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <pthread.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <thread>

#include "core/rt/executor.hpp"
#include "drivers/can/node/cia402_node.hpp"
#include "drivers/can/socket_can_port.hpp"
#include "drivers/driver.h"

namespace wb::can {

inline constexpr TimeNs kCycle = 2'500'000;

inline void raise_priority(pthread_t thread, int priority) {
  sched_param param{};
  param.sched_priority = priority;
  pthread_setschedparam(thread, SCHED_FIFO, &param);
}

// A command of the guest's shell; its failure is the test's.
inline void shell(const std::string& command) {
  EXPECT_EQ(std::system((command + " 2>/dev/null").c_str()), 0) << command;
}

// n drives on an interface: a bus of their own without bit times, bridged to the kernel's.
class Drives {
 public:
  Drives(const std::string& interface, int first_node, int n)
      : port_(interface, 1e6), bus_(options()), wire_(bus_.attach("wire")) {
    for (int i = 0; i < n; ++i) {
      models_.push_back(std::make_unique<IntegratorModel>());
      NodeOptions o;
      o.node_id = first_node + i;
      nodes_.push_back(std::make_unique<Cia402Node>(o, bus_, *models_.back()));
    }
    thread_ = std::thread([this] { run(); });
    raise_priority(thread_.native_handle(), 75);
  }
  ~Drives() {
    stopping_ = true;
    thread_.join();
  }
  std::uint64_t followed() const { return followed_; }  // RPDOs, all drives together
  int enabled() const { return enabled_; }

 private:
  static BusOptions options() {
    BusOptions o;
    o.bit_rate = 1e9;
    o.transmit_queue = 1024;
    return o;
  }
  void run() {
    std::array<Frame, 64> frames;
    while (!stopping_) {
      pollfd p{port_.file(), POLLIN, 0};
      const timespec wait{0, 250'000};
      ppoll(&p, 1, &wait, nullptr);
      for (int n; (n = port_.receive(frames.data(), 64)) > 0;) wire_.send(frames.data(), n);
      bus_.advance(RealTime::monotonic() - start_);  // its clock begins at 0
      // What the kernel's queue has no room for is lost, as on a real drive.
      for (int n; (n = wire_.receive(frames.data(), 64)) > 0;) port_.send(frames.data(), n);
      if (!carries_frames(port_.status().state)) port_.reopen();
      std::uint64_t followed = 0;
      int enabled = 0;
      for (const auto& node : nodes_) {
        followed += node->rpdos_followed();
        enabled += node->enabled();
      }
      followed_ = followed;
      enabled_ = enabled;
    }
  }

  const TimeNs start_ = RealTime::monotonic();
  SocketCanPort port_;
  InProcessBus bus_;
  CanPort& wire_;
  std::vector<std::unique_ptr<IntegratorModel>> models_;
  std::vector<std::unique_ptr<Cia402Node>> nodes_;
  std::atomic<bool> stopping_{false};
  std::atomic<std::uint64_t> followed_{0};
  std::atomic<int> enabled_{0};
  std::thread thread_;
};

// The plugin with the test's thread as its control loop.
class Master {
 public:
  explicit Master(const std::string& config) {
    void* library = dlopen(WB_BUILD_DIR "/drivers/libwb_driver_can.so", RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) throw std::runtime_error(dlerror());
    api_ = reinterpret_cast<wb_driver_entry_fn>(dlsym(library, WB_DRIVER_ENTRY))();
    driver_ = api_->create(config.c_str(), "/", note, &log_);
    if (driver_ == nullptr) throw std::runtime_error(log_);
    api_->describe(driver_, &description_);
    diagnostics_ = static_cast<const wb_diagnostics*>(api_->get_extension(driver_, WB_DIAGNOSTICS));
  }
  ~Master() { api_->destroy(driver_); }

  // Sets the drives up, and runs until all of them follow; false: they do not.
  [[nodiscard]] bool start() { return api_->configure(driver_) == WB_OK && activate(); }
  [[nodiscard]] bool activate() {
    const std::vector<wb_timeout_action> actions(WB_DRIVER_MAX_JOINTS, WB_TIMEOUT_HOLD);
    api_->deactivate(driver_);
    for (int i = 0; i < 400; ++i) {
      if (api_->activate(driver_, 100'000'000, actions.data()) == WB_OK) break;
      run(0.01);
    }
    for (int i = 0; i < 400 && !all(WB_JOINT_FOLLOWING); ++i) run(kCycle * 1e-9);
    return all(WB_JOINT_FOLLOWING);
  }
  // Reads and writes each cycle: every joint where it is.
  void run(double seconds) {
    const auto cycles = static_cast<std::int64_t>(seconds * 1e9 / kCycle + 0.5);
    TimeNs next = RealTime::monotonic();
    for (std::int64_t i = 0; i < cycles; ++i) {
      next = std::max(next + kCycle, RealTime::monotonic());
      const timespec at{next / kNanosPerSecond, next % kNanosPerSecond};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
      result_ = api_->read(driver_, &readings_);
      wb_commands c{};
      c.t_ns = RealTime::monotonic();
      for (std::uint32_t j = 0; j < description_.joint_count; ++j) {
        c.joints[j].kind = WB_CMD_POSITION;
        c.joints[j].position = readings_.joints[j].position;
      }
      (void)api_->write(driver_, &c);
    }
  }
  bool all(wb_joint_status status) const {
    for (std::uint32_t j = 0; j < description_.joint_count; ++j) {
      if (readings_.joints[j].status != static_cast<std::uint32_t>(status)) return false;
    }
    return true;
  }
  // None moves by command any more.
  bool none_follows() const {
    for (std::uint32_t j = 0; j < description_.joint_count; ++j) {
      if (readings_.joints[j].status == WB_JOINT_FOLLOWING) return false;
    }
    return true;
  }
  std::uint64_t count(const std::string& name) const {
    std::vector<std::uint64_t> values(diagnostics_->count);
    diagnostics_->read(driver_, values.data());
    for (std::uint32_t i = 0; i < diagnostics_->count; ++i) {
      if (name == diagnostics_->names[i]) return values[i];
    }
    ADD_FAILURE() << "no counter " << name;
    return 0;
  }
  const std::string& log() const { return log_; }

 private:
  static void note(void* user, wb_log_level level, const char* text) {
    if (level >= WB_LOG_WARN) *static_cast<std::string*>(user) += std::string(text) + "\n";
  }
  const wb_driver_api* api_ = nullptr;
  wb_driver* driver_ = nullptr;
  const wb_diagnostics* diagnostics_ = nullptr;
  wb_description description_{};
  wb_readings readings_{};
  wb_status result_ = WB_OK;
  std::string log_;
};

// Frames from somebody else on the bus, error frames among them.
class Stranger {
 public:
  explicit Stranger(const std::string& interface) : socket_(socket(PF_CAN, SOCK_RAW, CAN_RAW)) {
    ifreq request{};
    std::strncpy(request.ifr_name, interface.c_str(), IFNAMSIZ - 1);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    EXPECT_EQ(ioctl(socket_, SIOCGIFINDEX, &request), 0);
    address.can_ifindex = request.ifr_ifindex;
    EXPECT_EQ(bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  }
  ~Stranger() { close(socket_); }
  void send(std::uint32_t id, std::initializer_list<std::uint8_t> data, int times = 1) const {
    can_frame frame{};
    frame.can_id = id;
    frame.len = static_cast<std::uint8_t>(data.size());
    std::copy(data.begin(), data.end(), frame.data);
    for (int i = 0; i < times; ++i) {
      while (write(socket_, &frame, sizeof frame) < 0 && errno == ENOBUFS) usleep(1000);
    }
  }

 private:
  int socket_;
};

// Drives 1 to `drives` on vxa, and, where there are two buses, as many on vxc. Bus threads of the
// plugin at priority 80.
inline std::string config(int drives, int buses = 1,
                          const std::string& supervision = "{velocity_every: 12}") {
  std::string text = "{sync_rate_hz: 400, supervision: " + supervision + ", buses: [";
  const char* interfaces[] = {"vxa", "vxc"};
  for (int b = 0; b < buses; ++b)
    text += std::string("{name: ") + interfaces[b] +
            ", type: socketcan, interface: " + interfaces[b] +
            ", bit_rate: 1000000, priority: 80},";
  text += "], drives: [";
  for (int b = 0; b < buses; ++b) {
    for (int i = 0; i < drives; ++i)
      text += "{joint: j" + std::to_string(b * drives + i) + ", bus: " + interfaces[b] +
              ", node: " + std::to_string(1 + i) +
              ", mode: csp, counts_per_rad: 1.0e5, torque_per_permille_nm: 0.1, "
              "velocity_max_radps: 3, effort_max_nm: 100},";
  }
  return text + "]}";
}

}  // namespace wb::can
