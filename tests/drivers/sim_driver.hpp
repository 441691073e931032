// The simulated-driver plugin as its host sees it: loaded from the build tree, stepped on a virtual
// clock. Joints are the description's: the arm in robot.yaml's order, then the wheels.
#pragma once
#include <dlfcn.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "core/types/time.hpp"
#include "drivers/driver.h"
#include "drivers/sim/truth.h"

namespace wb::test {

inline constexpr TimeNs kTick = 2'500'000;

// robot, scene and seed, then whatever the test adds.
inline std::string sim_config(const std::string& more, int seed = 1) {
  return "{robot: robots/mabi_mobile, scene: scenes/kitchen_line.yaml, seed: " +
         std::to_string(seed) + ", " + more + "}";
}

class SimDriver {
 public:
  explicit SimDriver(const std::string& config,
                     const std::string& library = WB_BUILD_DIR "/drivers/libwb_driver_sim.so") {
    void* handle =
        dlopen(library.c_str(),
               RTLD_NOW | RTLD_LOCAL);  // stays loaded: other drivers of the test share it
    if (handle == nullptr) throw std::runtime_error(dlerror());
    api_ = reinterpret_cast<wb_driver_entry_fn>(dlsym(handle, WB_DRIVER_ENTRY))();
    driver_ = api_->create(config.c_str(), WB_SOURCE_DIR "/config", note, &log_);
    if (driver_ == nullptr) throw std::runtime_error(log_);
    api_->describe(driver_, &description_);
    api_->configure(driver_);
    truth_ = static_cast<const wb_sim_truth*>(api_->get_extension(driver_, WB_SIM_TRUTH));
    view_ = static_cast<const wb_sim_view*>(api_->get_extension(driver_, WB_SIM_VIEW));
    fault_ = static_cast<const wb_sim_fault*>(api_->get_extension(driver_, WB_SIM_FAULT));
  }
  ~SimDriver() {
    if (driver_ != nullptr) api_->destroy(driver_);
  }
  SimDriver(const SimDriver&) = delete;
  SimDriver& operator=(const SimDriver&) = delete;

  const wb_driver_api& api() const { return *api_; }
  wb_driver* get() const { return driver_; }
  const wb_description& description() const { return description_; }
  const wb_sim_truth& truth() const { return *truth_; }
  const wb_sim_view& view() const { return *view_; }
  const wb_sim_fault& fault() const { return *fault_; }
  TimeNs now() const { return now_; }
  int wheels() const { return 2; }
  int arm() const { return static_cast<int>(description_.joint_count) - wheels(); }

  wb_status activate(wb_timeout_action arm_action = WB_TIMEOUT_HOLD,
                     TimeNs timeout_ns = 50'000'000) {
    std::vector<wb_timeout_action> actions(description_.joint_count, arm_action);
    std::fill(actions.begin() + arm(), actions.end(), WB_TIMEOUT_BRAKE);
    return api_->activate(driver_, timeout_ns, actions.data());
  }
  wb_readings read() const {
    wb_readings out{};
    if (api_->read(driver_, &out) != WB_OK) throw std::runtime_error("read failed");
    return out;
  }
  wb_status write(wb_commands commands) const {
    commands.t_ns = now_;
    return api_->write(driver_, &commands);
  }
  void advance(TimeNs duration_ns) {
    now_ += duration_ns;
    if (api_->advance(driver_, now_) != WB_OK) throw std::runtime_error("advance failed");
  }
  // Writes commands(t) every tick.
  template <class Commands>
  void run(double duration_s, Commands&& commands) {
    for (const TimeNs end = now_ + from_seconds(duration_s); now_ < end; advance(kTick))
      write(commands(now_));
  }

  wb_sim_object object(const std::string& name) const {
    wb_sim_object out{};
    for (std::uint32_t i = 0; i < truth_->object_count(driver_); ++i) {
      if (truth_->object(driver_, i, &out) == WB_OK && name == out.name) return out;
    }
    throw std::runtime_error("no object " + name);
  }
  std::uint32_t object_index(const std::string& name) const {
    wb_sim_object out{};
    for (std::uint32_t i = 0; i < truth_->object_count(driver_); ++i) {
      if (truth_->object(driver_, i, &out) == WB_OK && name == out.name) return i;
    }
    throw std::runtime_error("no object " + name);
  }

 private:
  static void note(void* user, wb_log_level level, const char* text) {
    if (level >= WB_LOG_WARN) *static_cast<std::string*>(user) = text;
  }

  std::string log_;
  const wb_driver_api* api_ = nullptr;
  wb_driver* driver_ = nullptr;
  wb_description description_{};
  const wb_sim_truth* truth_ = nullptr;
  const wb_sim_view* view_ = nullptr;
  const wb_sim_fault* fault_ = nullptr;
  TimeNs now_ = 0;
};

}  // namespace wb::test
