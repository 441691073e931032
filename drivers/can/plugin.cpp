// libwb_driver_can.so: the driver ABI over CiA 402 drives on CAN buses (docs/how-to/can.md). Setup:
// create, configure, activate, deactivate, destroy. Ports: read, write, stop, advance; advance() of
// paced buses waits for the hub, bounded by pace_timeout_ms. Log lines come from a thread of their
// own, never from a port.
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <exception>
#include <memory>
#include <string>
#include <string_view>
#include <thread>

#include "drivers/can/can_driver.hpp"
#include "drivers/can/socket_can_port.hpp"
#include "drivers/driver.h"

namespace wb::can {
namespace {

// All buses of the plugin share one tick: all begin it, then all end it.
class SocketPacer final : public Pacer {
 public:
  SocketPacer(std::vector<SocketBusPort*> ports, int timeout_ms)
      : ports_(std::move(ports)), timeout_ms_(timeout_ms) {
    for (SocketBusPort* p : ports_) now_ = std::max(now_, p->bus_time());
  }
  TimeNs bus_time() const RT_SAFE override { return now_; }
  bool advance(const Tick& tick) RT_SAFE override {
    bool all = true;
    for (SocketBusPort* p : ports_) all = p->begin_tick(tick) && all;
    for (SocketBusPort* p : ports_) all = p->end_tick(timeout_ms_) && all;
    now_ = std::max(now_, tick.bus_ns);
    return all;
  }

 private:
  std::vector<SocketBusPort*> ports_;
  int timeout_ms_;
  TimeNs now_ = 0;
};

}  // namespace
}  // namespace wb::can

struct wb_driver {
  wb_driver(const char* text, const char* folder, wb_log log, void* log_user) {
    using namespace wb::can;
    PluginConfig config = PluginConfig::parse(text, folder);
    std::vector<CanPort*> all;
    std::vector<SocketBusPort*> paced;
    for (const BusConfig& bus : config.buses) {
      if (bus.type == BusConfig::Type::kUnix) {
        auto port = std::make_unique<SocketBusPort>(bus.path, bus.paced);
        if (bus.paced) paced.push_back(port.get());
        ports.push_back(std::move(port));
      } else {
        ports.push_back(std::make_unique<SocketCanPort>(bus.interface, bus.bit_rate));
      }
      all.push_back(ports.back().get());
      if (log) {
        char line[160];
        std::snprintf(line, sizeof line, "CAN bus %s: worst-case load %.0f %% of %.0f kbit/s%s",
                      bus.name.c_str(), 100 * bus.load, 1e-3 * bus.bit_rate,
                      bus.paced ? ", paced" : "");
        log(log_user, WB_LOG_INFO, line);
      }
    }
    if (config.paced()) pacer = std::make_unique<SocketPacer>(paced, config.pace_timeout_ms);
    driver = std::make_unique<CanDriver>(config, all, pacer.get());
    logger = std::thread([this, log, log_user] {
      const auto line = [&](wb_log_level level, const std::string& l) {
        if (log) log(log_user, level, l.c_str());
      };
      while (!ends) {
        driver->wait_for_log();
        driver->drain_log(line);
      }
      driver->drain_log(line);
    });
  }
  ~wb_driver() {
    driver->close();
    ends = true;
    driver->wake_log();
    logger.join();
  }

  std::vector<std::unique_ptr<wb::can::CanPort>> ports;
  std::unique_ptr<wb::can::Pacer> pacer;
  std::unique_ptr<wb::can::CanDriver> driver;
  std::atomic<bool> ends{false};
  std::thread logger;
};

namespace wb::can {
namespace {

wb_driver* create(const char* config, const char* folder, wb_log log, void* log_user) {
  try {
    return new wb_driver(config, folder, log, log_user);
  } catch (const std::exception& error) {
    if (log) log(log_user, WB_LOG_ERROR, error.what());
    return nullptr;
  }
}
void destroy(wb_driver* d) { delete d; }
wb_status describe(const wb_driver* d, wb_description* out) {
  d->driver->describe(*out);
  return WB_OK;
}
wb_status configure(wb_driver* d) {
  try {
    return d->driver->configure();
  } catch (const std::exception&) {
    return WB_ERROR;
  }
}
wb_status activate(wb_driver* d, std::int64_t timeout_ns, const wb_timeout_action* actions) {
  return d->driver->activate(timeout_ns, actions);
}
wb_status deactivate(wb_driver* d) { return d->driver->deactivate(); }
wb_status read(wb_driver* d, wb_readings* out) { return d->driver->read(*out); }
wb_status write(wb_driver* d, const wb_commands* c) { return d->driver->write(*c); }
wb_status stop(wb_driver* d) { return d->driver->stop(); }
wb_status acquire_frame(wb_driver*, wb_frame*) { return WB_NO_DATA; }
wb_status release_frame(wb_driver*, std::uint64_t) { return WB_ERROR; }
wb_status advance(wb_driver* d, std::int64_t t_ns) { return d->driver->advance(t_ns); }

const void* get_extension(wb_driver*, const char* name) {
  static const wb_diagnostics diagnostics = {
      static_cast<std::uint32_t>(CanDriver::counter_names().size()),
      CanDriver::counter_names().data(),
      [](const wb_driver* d, std::uint64_t* values) { d->driver->counters(values); }};
  return std::string_view(name) == WB_DIAGNOSTICS ? &diagnostics : nullptr;
}

}  // namespace
}  // namespace wb::can

extern "C" __attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry() {
  using namespace wb::can;
  static const wb_driver_api api = {WB_DRIVER_ABI, sizeof(wb_driver_api),
                                    create,        destroy,
                                    describe,      configure,
                                    activate,      deactivate,
                                    read,          write,
                                    stop,          acquire_frame,
                                    release_frame, advance,
                                    get_extension};
  return &api;
}
