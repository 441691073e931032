// The plugin as its host loads it, against drives behind a Unix socket: paced, and in real time on
// its own threads.
#include <dlfcn.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <functional>
#include <mutex>

#include "drivers/driver.h"
#include "tests/drivers/can/node_hub.hpp"

namespace wb::can {
namespace {

constexpr TimeNs kMs = 1'000'000;

std::filesystem::path socket_path(const char* name) {
  return std::filesystem::temp_directory_path() /
         ("wb_can_plugin_" + std::to_string(::getpid()) + "_" + name);
}

struct Plugin {
  Plugin() {
    library = dlopen(WB_BUILD_DIR "/drivers/libwb_driver_can.so", RTLD_NOW | RTLD_LOCAL);
    if (!library) throw std::runtime_error(dlerror());
    api = reinterpret_cast<wb_driver_entry_fn>(dlsym(library, WB_DRIVER_ENTRY))();
  }
  ~Plugin() {
    if (driver) api->destroy(driver);
    dlclose(library);
  }
  bool create(const std::string& config) {
    const wb_log log = [](void* user, wb_log_level, const char* text) {
      auto* self = static_cast<Plugin*>(user);
      const std::lock_guard lock(self->mutex);
      self->log += std::string(text) + "\n";
    };
    driver = api->create(config.c_str(), "/", log, this);
    return driver != nullptr;
  }
  std::string lines() {
    const std::lock_guard lock(mutex);
    return log;
  }
  wb_status activate(TimeNs timeout_ns) {
    const wb_timeout_action actions[WB_DRIVER_MAX_JOINTS] = {};
    return api->activate(driver, timeout_ns, actions);
  }
  wb_status write(TimeNs t, double arm, double wheel) {
    wb_commands c{};
    c.t_ns = t;
    for (int i = 0; i < 3; ++i) {
      c.joints[i].kind = WB_CMD_POSITION;
      c.joints[i].position = arm;
    }
    c.joints[3].kind = WB_CMD_VELOCITY;
    c.joints[3].velocity = wheel;
    return api->write(driver, &c);
  }
  bool all_follow() const {
    for (int i = 0; i < 4; ++i) {
      if (readings.joints[i].status != WB_JOINT_FOLLOWING) return false;
    }
    return true;
  }
  std::uint64_t counter(const std::string& name) const {
    const auto* d = static_cast<const wb_diagnostics*>(api->get_extension(driver, WB_DIAGNOSTICS));
    std::vector<std::uint64_t> values(d->count);
    d->read(driver, values.data());
    for (std::uint32_t i = 0; i < d->count; ++i) {
      if (name == d->names[i]) return values[i];
    }
    return UINT64_MAX;
  }
  void* library = nullptr;
  const wb_driver_api* api = nullptr;
  wb_driver* driver = nullptr;
  wb_readings readings{};
  std::mutex mutex;
  std::string log;
};

TEST(CanPlugin, PacedBusRunsOnTheHostsClock) {
  const auto path = socket_path("paced");
  NodeHub hub(path, true, 4);
  Plugin p;
  ASSERT_TRUE(p.create(hub_config(path, true))) << p.lines();
  ASSERT_EQ(p.api->configure(p.driver), WB_OK) << p.lines();
  wb_description d;
  ASSERT_EQ(p.api->describe(p.driver, &d), WB_OK);
  EXPECT_EQ(d.can_step, 1u);
  EXPECT_EQ(d.joint_count, 4u);
  EXPECT_EQ(d.joints[3].is_wheel, 1u);
  EXPECT_EQ(d.joints[3].command_kinds, 1u << WB_CMD_VELOCITY);
  ASSERT_EQ(p.api->advance(p.driver, 0), WB_OK);
  ASSERT_EQ(p.activate(50 * kMs), WB_OK);
  for (int k = 1; k <= 400; ++k) {
    const TimeNs t = k * TimeNs{2'500'000};
    // Between control ticks come other instants, as the lockstep executor makes them.
    if (k % 3 == 0) {
      ASSERT_EQ(p.api->advance(p.driver, t - 700'000), WB_OK);
    }
    ASSERT_EQ(p.api->advance(p.driver, t), WB_OK);
    ASSERT_EQ(p.api->read(p.driver, &p.readings), WB_OK);
    ASSERT_EQ(p.write(t, 0.1 + 0.1 * (1 - std::cos(3e-9 * static_cast<double>(t))), 0.5), WB_OK)
        << k << p.lines();
  }
  EXPECT_TRUE(p.all_follow()) << p.lines();
  EXPECT_NEAR(p.readings.joints[0].position, 0.1 + 0.1 * (1 - std::cos(3.0)), 0.01);
  EXPECT_NEAR(p.readings.joints[3].velocity, 0.5, 1e-3);
  EXPECT_LE(p.readings.t_ns, 1'000 * kMs);
  EXPECT_GE(p.readings.t_ns, 995 * kMs);
  EXPECT_EQ(p.counter("tpdo_late"), 0u);
  // A SYNC for each control tick, and none for the instants between them.
  EXPECT_LE(p.counter("cycles"), 400u + 200u);
  EXPECT_TRUE(hub.enabled(0));
  p.api->destroy(p.driver);
  p.driver = nullptr;
  EXPECT_FALSE(hub.enabled(0));
  EXPECT_NE(p.lines().find("identified"), std::string::npos);
}

TEST(CanPlugin, HubThatGoesAwayIsAnErrorOfAdvanceAndStops) {
  const auto path = socket_path("gone");
  auto hub = std::make_unique<NodeHub>(path, true, 4);
  Plugin p;
  ASSERT_TRUE(p.create(hub_config(path, true))) << p.lines();
  ASSERT_EQ(p.api->configure(p.driver), WB_OK) << p.lines();
  ASSERT_EQ(p.api->advance(p.driver, 0), WB_OK);
  ASSERT_EQ(p.activate(50 * kMs), WB_OK);
  hub.reset();
  EXPECT_EQ(p.api->advance(p.driver, 2'500'000), WB_TIMED_OUT);
  ASSERT_EQ(p.api->read(p.driver, &p.readings), WB_OK);
  EXPECT_EQ(p.readings.timed_out, 1u);
  EXPECT_EQ(p.counter("bus_timeout"), 1u);
}

TEST(CanPlugin, ConfigurationErrorsAreLogLines) {
  Plugin p;
  EXPECT_FALSE(p.create("{sync_rate: 1}"));
  EXPECT_NE(p.lines().find("sync_rate"), std::string::npos) << p.lines();
  EXPECT_FALSE(p.create(hub_config(socket_path("nobody"), true)));
  EXPECT_NE(p.lines().find("nobody"), std::string::npos) << p.lines();
}

// Real time on a machine that may be slow: long thresholds, and only what must hold whenever it is
// that things happen.
TEST(CanPlugin, BusThreadDrivesInRealTimeAndStopsWhenWritesCease) {
  const auto path = socket_path("real");
  NodeHub hub(path, false, 4);
  Plugin p;
  ASSERT_TRUE(p.create(hub_config(
      path, false,
      "supervision: {tpdo_lost_max: 1000, tpdo_window: 1, heartbeat_ms: 100, heartbeat_lost_ms: "
      "30000, rpdo_timeout_ms: 20000, sdo_timeout_ms: 2000, setup_timeout_ms: 60000, "
      "enable_timeout_ms: 30000, following_ms: 20000, duplicates_max: 1000, command_age_ms: "
      "5000}\n")))
      << p.lines();
  wb_description d;
  ASSERT_EQ(p.api->describe(p.driver, &d), WB_OK);
  EXPECT_EQ(d.can_step, 0u);
  EXPECT_EQ(p.api->advance(p.driver, 0), WB_BAD_STATE);
  ASSERT_EQ(p.api->configure(p.driver), WB_OK) << p.lines();
  ASSERT_EQ(p.activate(5'000 * kMs), WB_OK) << p.lines();
  const auto now = [] {
    timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec;
  };
  const auto tick = [&](const std::function<bool()>& done) {
    for (const TimeNs end = now() + 60'000 * kMs; now() < end && !done();) {
      const timespec wait{0, 5 * kMs};
      nanosleep(&wait, nullptr);
      (void)p.api->read(p.driver, &p.readings);
    }
    return done();
  };
  ASSERT_TRUE(tick([&] {
    (void)p.write(now(), 0.1, 0.2);
    return p.all_follow();
  })) << p.lines();
  EXPECT_TRUE(tick([&] {
    (void)p.write(now(), 0.1, 0.2);
    return std::abs(p.readings.joints[3].velocity - 0.2) < 1e-3;
  }));
  // No write any more: the bus's own thread notices.
  EXPECT_TRUE(tick([&] { return p.readings.timed_out != 0; }));
  EXPECT_EQ(p.write(now(), 0.1, 0.2), WB_TIMED_OUT);
  EXPECT_TRUE(tick([&] { return std::abs(p.readings.joints[3].velocity) < 1e-3; }));
  EXPECT_EQ(p.api->deactivate(p.driver), WB_OK);
}

}  // namespace
}  // namespace wb::can
