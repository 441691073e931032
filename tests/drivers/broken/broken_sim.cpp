// The simulator's plugin with at most one defect around it, chosen by -DDEFECT=kName, to show that
// the conformance suite finds it; kNone conforms as the simulator does.
#include <dlfcn.h>

#include <cstdint>

#include "drivers/driver.h"

namespace {

enum class Defect { kNone, kStartsByItself, kNeverTimesOut, kFrozenPositions };
constexpr Defect kDefect = Defect::DEFECT;
constexpr bool is(Defect defect) { return kDefect == defect; }

const wb_driver_api& sim() {
  static const auto* api = [] {
    void* library = dlopen(WB_SIM_PLUGIN, RTLD_NOW | RTLD_LOCAL);
    const auto entry = reinterpret_cast<wb_driver_entry_fn>(dlsym(library, WB_DRIVER_ENTRY));
    return entry();
  }();
  return *api;
}

}  // namespace

struct wb_driver {
  wb_driver* inner = nullptr;
  wb_description description{};
  wb_readings first{};
  wb_commands commands{};
  bool commanded = false, frozen = false;
};

namespace {

wb_driver* create(const char* config, const char* folder, wb_log log, void* user) {
  wb_driver* inner = sim().create(config, folder, log, user);
  if (!inner) return nullptr;
  auto* d = new wb_driver;
  d->inner = inner;
  sim().describe(inner, &d->description);
  return d;
}
void destroy(wb_driver* d) {
  sim().destroy(d->inner);
  delete d;
}
wb_status describe(const wb_driver* d, wb_description* out) {
  return sim().describe(d->inner, out);
}
wb_status configure(wb_driver* d) { return sim().configure(d->inner); }

wb_status activate(wb_driver* d, std::int64_t timeout_ns, const wb_timeout_action* actions) {
  const wb_status s = sim().activate(d->inner, timeout_ns, actions);
  d->commanded = d->frozen = false;
  if (s != WB_OK || !is(Defect::kStartsByItself)) return s;
  for (std::uint32_t j = 0; j < d->description.joint_count; ++j) {
    if (!d->description.joints[j].is_wheel) continue;
    d->commands.joints[j].kind = WB_CMD_VELOCITY;
    d->commands.joints[j].velocity = 0.2;
  }
  return sim().write(d->inner, &d->commands);
}
wb_status deactivate(wb_driver* d) {
  d->commanded = d->frozen = false;
  return sim().deactivate(d->inner);
}
wb_status read(wb_driver* d, wb_readings* out) {
  const wb_status s = sim().read(d->inner, out);
  if (s != WB_OK || !is(Defect::kFrozenPositions) || !d->commanded) return s;
  if (!d->frozen) d->first = *out;
  d->frozen = true;
  for (std::uint32_t j = 0; j < d->description.joint_count; ++j)
    out->joints[j].position = d->first.joints[j].position;
  return s;
}
wb_status write(wb_driver* d, const wb_commands* commands) {
  const wb_status s = sim().write(d->inner, commands);
  if (s == WB_OK) d->commands = *commands, d->commanded = true;
  return s;
}
wb_status stop(wb_driver* d) {
  d->commanded = false;
  return sim().stop(d->inner);
}
wb_status acquire_frame(wb_driver* d, wb_frame* out) { return sim().acquire_frame(d->inner, out); }
wb_status release_frame(wb_driver* d, std::uint64_t token) {
  return sim().release_frame(d->inner, token);
}
wb_status advance(wb_driver* d, std::int64_t t_ns) {
  if (is(Defect::kNeverTimesOut) && d->commanded) (void)sim().write(d->inner, &d->commands);
  return sim().advance(d->inner, t_ns);
}
// The simulator's would be called with this plugin's instance.
const void* get_extension(wb_driver*, const char*) { return nullptr; }

}  // namespace

extern "C" __attribute__((visibility("default"))) const wb_driver_api* wb_driver_entry() {
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
