// One simulated plant behind the driver ABI: what a wb_driver handle points to, and the clock it
// shares with its host. The plant's time starts at 0 of the host's clock in lockstep, and at the
// first advance() in real time (render_thread).
#pragma once
#include <memory>

#include "drivers/sim/cameras.hpp"
#include "drivers/sim/plant.hpp"

namespace wb::sim {

struct Faults {
  bool silent = false, frozen = false, emergency_stop = false;
};

// The scene's parts with their places in the model, in the order of the file.
struct Object {
  const Unit* unit = nullptr;
  const Part* part = nullptr;
  int joint = 0, body = 0, unit_body = 0;
};

const void* find_extension(const char* name);

}  // namespace wb::sim

struct wb_driver {
  wb::sim::PluginConfig config;
  wb::sim::Plant plant;
  wb::sim::Cameras cameras;
  std::vector<wb::sim::Object> objects;

  wb_state state = WB_UNCONFIGURED;
  bool clock_started = false;
  wb::TimeNs offset_ns = 0;  // the host's clock less the plant's
  wb::sim::Faults faults;
  wb_readings frozen{};  // what read returns while frozen, ages as of its stamp

  explicit wb_driver(wb::sim::PluginConfig c);
  wb::TimeNs now_ns() const noexcept { return plant.time_ns() + offset_ns; }
};
