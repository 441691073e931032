// A low-level computer on a thread of the test and the plugin as its host loads it, in a DDS domain
// of this process's own on loopback.
#pragma once
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "drivers/sim/truth.h"
#include "tests/dds_domain.hpp"
#include "tests/drivers/dds/fake_robot.hpp"

namespace wb::dds {

using test::wait_until;

inline void sleep_s(double s) { std::this_thread::sleep_for(std::chrono::duration<double>(s)); }

// LowLevel and its robot on a thread.
class LowLevelThread {
 public:
  LowLevelThread(const LowLevelOptions& options, const wb_description& description)
      : robot(description, options.paced), low_level(options, description, robot) {}
  ~LowLevelThread() {
    stopping_ = true;
    if (thread_.joinable()) thread_.join();
  }
  void start() {
    thread_ = std::thread([this] {
      while (!stopping_) {
        if (paused) {
          sleep_s(0.001);
          continue;
        }
        low_level.spin(5'000'000);
        if (each) each();
      }
    });
  }
  // Set before start(): runs on the low-level thread after each spin.
  std::function<void()> each;
  std::atomic<bool> paused{false};  // a low-level computer that hangs
  FakeRobot robot;
  LowLevel low_level;

 private:
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

// The plugin, driven by the test's thread as control.
class Plugin {
 public:
  explicit Plugin(const std::string& config) {
    void* handle = dlopen(WB_BUILD_DIR "/drivers/libwb_driver_dds.so", RTLD_NOW | RTLD_LOCAL);
    if (handle == nullptr) throw std::runtime_error(dlerror());
    api_ = reinterpret_cast<wb_driver_entry_fn>(dlsym(handle, WB_DRIVER_ENTRY))();
    driver_ = api_->create(config.c_str(), "", note, &log_);
    if (driver_ == nullptr) throw std::runtime_error(log_);
    api_->describe(driver_, &description);
    api_->configure(driver_);
  }
  ~Plugin() { api_->destroy(driver_); }
  Plugin(const Plugin&) = delete;
  Plugin& operator=(const Plugin&) = delete;

  const wb_driver_api& api() const { return *api_; }
  wb_driver* get() const { return driver_; }
  const std::string& log() const { return log_; }

  wb_status activate(TimeNs timeout_ns = 500'000'000, wb_timeout_action action = WB_TIMEOUT_HOLD) {
    wb_timeout_action actions[WB_DRIVER_MAX_JOINTS];
    std::fill_n(actions, WB_DRIVER_MAX_JOINTS, action);
    return api_->activate(driver_, timeout_ns, actions);
  }
  wb_status deactivate() { return api_->deactivate(driver_); }
  wb_status read() { return api_->read(driver_, &readings); }
  wb_status write(const wb_commands& c) { return api_->write(driver_, &c); }
  wb_status advance(TimeNs t) { return api_->advance(driver_, t); }
  std::uint64_t count(const std::string& name) const {
    const auto* d =
        static_cast<const wb_diagnostics*>(api_->get_extension(driver_, WB_DIAGNOSTICS));
    std::vector<std::uint64_t> values(d->count);
    d->read(driver_, values.data());
    for (std::uint32_t i = 0; i < d->count; ++i) {
      if (name == d->names[i]) return values[i];
    }
    throw std::runtime_error("no counter " + name);
  }

  wb_description description{};
  wb_readings readings{};

 private:
  static void note(void* user, wb_log_level level, const char* text) {
    if (level >= WB_LOG_WARN) *static_cast<std::string*>(user) = text;
  }
  std::string log_;
  const wb_driver_api* api_ = nullptr;
  wb_driver* driver_ = nullptr;
};

inline wb_commands velocity_commands(int joints, double velocity) {
  wb_commands c{};
  for (int i = 0; i < joints; ++i) {
    c.joints[i].kind = WB_CMD_VELOCITY;
    c.joints[i].velocity = velocity;
  }
  c.gripper.opening = 0.02;
  c.gripper.force = 10;
  return c;
}

class DdsDriverTest : public ::testing::Test {
 protected:
  static int domain() {
    static const int own = test::own_dds_domain();
    return own;
  }

  static LowLevelOptions low_level_options(bool paced = false) {
    LowLevelOptions o;
    o.domain = domain();
    o.paced = paced;
    o.command_memory_ns = 2 * kNanosPerSecond;  // a loaded machine may be slow
    return o;
  }
  // A plugin that takes everything, patient enough for a loaded machine.
  static std::string config(bool paced = false, const std::string& more = "",
                            int tick_timeout_ms = 20'000) {
    return "{domain: " + std::to_string(domain()) +
           ", prefix: robot, clock: " + (paced ? "paced" : "ros") +
           ", joints: all, imu: measurements, wrench: measurements, gripper: true, "
           "sample_memory_ms: 400, silence_ms: 1000, tick_timeout_ms: " +
           std::to_string(tick_timeout_ms) + more + "}";
  }

  void start_low_level(bool paced = false) {
    low_level = std::make_unique<LowLevelThread>(low_level_options(paced), fake_description());
    low_level->start();
  }
  void start(bool paced = false, const std::string& more = "") {
    start_low_level(paced);
    plugin = std::make_unique<Plugin>(config(paced, more));
  }
  FakeRobot& robot() { return low_level->robot; }
  // So many measurements later, that is: what the low-level computer does by then, it does.
  void let_work(int measurements = 20) {
    const auto& sent = low_level->low_level.counts().measurements;
    const std::uint64_t then = sent + static_cast<std::uint64_t>(measurements);
    ASSERT_TRUE(wait_until([&] { return sent >= then; }));
  }

  // Writes `commands` every 5 ms until the condition holds.
  bool write_until(const wb_commands& commands, const std::function<bool()>& condition) {
    return wait_until([&] {
      plugin->write(commands);
      sleep_s(0.004);
      return condition();
    });
  }

  std::unique_ptr<LowLevelThread> low_level;
  std::unique_ptr<Plugin> plugin;
};

}  // namespace wb::dds
