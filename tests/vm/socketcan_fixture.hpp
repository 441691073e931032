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
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/rt/executor.hpp"
#include "drivers/can/node/cia402_node.hpp"
#include "drivers/can/socket_can_port.hpp"
#include "drivers/driver.h"

namespace wb::can {

inline constexpr TimeNs kCycle = 2'500'000;

// 0: an ordinary thread.
inline void set_priority(pthread_t thread, int priority) {
  sched_param param{};
  param.sched_priority = priority;
  pthread_setschedparam(thread, priority > 0 ? SCHED_FIFO : SCHED_OTHER, &param);
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
    set_priority(thread_.native_handle(), 75);
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
      // Not without a pause: a socket opened on an interface that is down is readable at once.
      if (!carries_frames(port_.status().state)) {
        port_.reopen();
        const timespec pause{0, 5'000'000};
        nanosleep(&pause, nullptr);
      }
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
    run(1, [this] { return all(WB_JOINT_FOLLOWING); });
    return all(WB_JOINT_FOLLOWING);
  }
  // Reads and writes each cycle: every joint where it is; ends early when `until` says so.
  void run(double seconds, const std::function<bool()>& until = {}) {
    const auto cycles = static_cast<std::int64_t>(seconds * 1e9 / kCycle + 0.5);
    TimeNs next = RealTime::monotonic();
    for (std::int64_t i = 0; i < cycles && !(until && until()); ++i) {
      next = std::max(next + kCycle, RealTime::monotonic());
      const timespec at{next / kNanosPerSecond, next % kNanosPerSecond};
      clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
      tick();
    }
  }
  void tick() {
    (void)api_->read(driver_, &readings_);
    if (readings_.timed_out && stopped_at_ < 0) stopped_at_ = RealTime::monotonic();
    wb_commands c{};
    c.t_ns = RealTime::monotonic();
    for (std::uint32_t j = 0; j < description_.joint_count; ++j) {
      c.joints[j].kind = WB_CMD_POSITION;
      c.joints[j].position = readings_.joints[j].position;
    }
    written_ = api_->write(driver_, &c);
  }
  // The same while an ordinary thread has the shell run a command; returns when that ended.
  TimeNs run_during(const std::string& command) {
    std::atomic<bool> done{false};
    std::thread thread([&] {
      set_priority(pthread_self(), 0);
      shell(command);
      done = true;
    });
    run(60, [&] { return done.load(); });
    const TimeNs end = RealTime::monotonic();
    thread.join();
    return end;
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
  // All stand, latched: commands are refused.
  bool stopped() const { return readings_.timed_out && written_ == WB_TIMED_OUT; }
  TimeNs stopped_at() const { return stopped_at_; }
  TimeNs last_answer() const { return readings_.t_ns; }
  void forget_stop() { stopped_at_ = -1; }
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
  wb_status written_ = WB_OK;
  TimeNs stopped_at_ = -1;
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

struct Setup {
  std::vector<std::string> interfaces = {"vxa"};
  int drives = 6;  // on each, nodes 1, 2, ...
  int sync_rate_hz = 400;
  int bit_rate = 1'000'000;
};

// The plugin's configuration; its bus threads have priority 80.
inline std::string config(const Setup& s = {}) {
  std::string text = "{sync_rate_hz: " + std::to_string(s.sync_rate_hz) +
                     ", supervision: {velocity_every: 12}, buses: [";
  for (const std::string& i : s.interfaces)
    text += "{name: " + i + ", type: socketcan, interface: " + i +
            ", bit_rate: " + std::to_string(s.bit_rate) + ", priority: 80},";
  text += "], drives: [";
  for (const std::string& i : s.interfaces) {
    for (int node = 1; node <= s.drives; ++node)
      text += "{joint: " + i + "_" + std::to_string(node) + ", bus: " + i +
              ", node: " + std::to_string(node) +
              ", mode: csp, counts_per_rad: 1.0e5, torque_per_permille_nm: 0.1, "
              "velocity_max_radps: 3, effort_max_nm: 100},";
  }
  return text + "]}";
}

constexpr int kDrives = 6;

// tests/vm/guest_can.sh has made the pairs vxa-vxb and vxc-vxd, vcan0, and can0 and can1 of two
// Kvaser cards on one bus.
class SocketCan : public ::testing::Test {
 protected:
  void SetUp() override {
    mlockall(MCL_CURRENT | MCL_FUTURE);
    set_priority(pthread_self(), 70);
    restore();
  }
  void TearDown() override { restore(); }
  void restore() {
    for (const char* i : {"vxa", "vxb", "vxc", "vxd"}) {
      (void)!std::system((std::string("tc qdisc del dev ") + i + " root 2>/dev/null").c_str());
      shell(std::string("ip link set ") + i + " up");
    }
  }
  // What happens to the frames that leave an interface.
  static std::string netem(const std::string& interface, const std::string& what) {
    return "tc qdisc replace dev " + interface + " root netem " + what;
  }
  static std::string no_netem(const std::string& interface) {
    return "tc qdisc del dev " + interface + " root";
  }

  // A row of the fault list that stops. begin, end: the shell's commands.
  struct Row {
    std::string begin, end;
    std::vector<std::string> metrics;      // all of these count
    std::function<void()> meanwhile = {};  // while the fault lasts, after the stop
  };
  // Detection, reaction, latch, recovery: counted, every joint stands, nothing moves when the fault
  // is over, and an activation brings all of them back.
  static void expect_stop(Master& master, const std::vector<const Drives*>& drives,
                          const Row& row) {
    const auto followed = [&] {
      std::uint64_t n = 0;
      for (const Drives* d : drives) n += d->followed();
      return n;
    };
    std::vector<std::uint64_t> before;
    for (const std::string& m : row.metrics) before.push_back(master.count(m));
    const std::uint64_t silent = master.count("command_timeout");
    master.forget_stop();
    const TimeNs start = RealTime::monotonic();
    const TimeNs end = master.run_during(row.begin);
    master.run(0.5);
    EXPECT_TRUE(master.stopped()) << master.log();
    EXPECT_TRUE(master.none_follows()) << master.log();
    EXPECT_EQ(master.count("command_timeout"), silent) << "the controller was late, not the fault";
    if (row.meanwhile) row.meanwhile();
    for (std::size_t i = 0; i < before.size(); ++i)
      EXPECT_GT(master.count(row.metrics[i]), before[i]) << row.metrics[i] << "\n" << master.log();
    if (master.stopped_at() >= 0)
      std::printf("%s: all stand %.1f ms after the command's start, %.1f ms after its end\n",
                  row.begin.c_str(), 1e3 * to_seconds(master.stopped_at() - start),
                  1e3 * to_seconds(master.stopped_at() - end));
    const std::uint64_t stopped = followed();
    master.run_during(row.end);
    master.run(1);
    EXPECT_EQ(followed(), stopped) << "a drive followed without an activation";
    EXPECT_TRUE(master.stopped());
    EXPECT_TRUE(master.none_follows());
    EXPECT_TRUE(master.activate()) << master.log();
    EXPECT_GT(followed(), stopped);
  }
};

}  // namespace wb::can
