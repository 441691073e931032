// One instance of the plugin under check, with its clock: virtual if it can step, else monotonic.
// Every call of a port is counted: allocations, thread CPU and wall time, log lines from within.
// One thread; failures of a check are thrown (Failed).
#pragma once
#include <array>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "core/types/time.hpp"
#include "drivers/check/driver_check.hpp"
#include "drivers/driver.h"

namespace wb::check {

struct Failed {
  std::string reason;
};
struct Skipped {
  std::string reason;
};
template <class... Parts>
[[noreturn]] void fail(const Parts&... parts);

// "WB_OK" and so on.
std::string text_of(wb_status status);
std::string text_of(double value);
std::string joint_status_text(std::uint32_t status);

enum Port { kRead, kWrite, kStop, kAdvance, kPorts };
inline constexpr const char* kPortNames[kPorts] = {"read", "write", "stop", "advance"};

struct PortUse {
  std::uint64_t calls = 0, allocations = 0, log_lines = 0;
  TimeNs cpu_max_ns = 0, wall_max_ns = 0;
};

// The loaded library; throws std::runtime_error if there is none.
class Library {
 public:
  explicit Library(const std::filesystem::path& file);
  const wb_driver_api* entry() const;  // null: no symbol, or it gave null

 private:
  void* handle_;
};

class Session {
 public:
  // Creates the plugin's instance; the state is unconfigured.
  explicit Session(const Options& options);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  const Options& options() const { return options_; }
  const wb_driver_api& api() const { return *api_; }
  wb_driver* get() const { return driver_; }
  const wb_description& description() const { return description_; }
  std::uint32_t joints() const { return description_.joint_count; }
  std::string joint(std::uint32_t j) const { return description_.joints[j].name; }
  bool steps() const { return description_.can_step != 0; }
  const wb_readings& readings() const { return readings_; }
  TimeNs now() const;  // the host's clock
  TimeNs period_ns() const { return period_ns_; }
  TimeNs timeout_ns() const { return timeout_ns_; }
  const std::array<PortUse, kPorts>& use() const { return use_; }
  // By how much the plugin's clock may lag or its samples may be late without being wrong.
  TimeNs slack_ns() const { return steps() ? period_ns_ : 5'000'000; }

  // Ports, as they are.
  wb_status read();
  wb_status write(const wb_commands& commands);
  wb_status stop();

  void configure();  // and describe; must succeed
  // configure, then reads until every joint is valid. Fails after start_s.
  void start();
  void activate();  // must succeed; notes where the joints are
  void deactivate();
  void tick();                // one period later
  void must_read();           // and succeed
  void rest(double seconds);  // ticks and reads, no writes

  // Stay where activate found the joints, by the kind that each supports.
  wb_commands hold() const;
  // Away from there at a tenth of the speed limit, at most 0.1 rad/s, towards the middle of the
  // range; t_s since the beginning of the sweep.
  wb_commands sweep(double t_s) const;
  // Accepted. Skips the check if this machine let the time-out pass by itself.
  void must_write(const wb_commands& commands);

  // Largest displacement of any joint while `each_tick` runs for so long; every tick is read.
  struct Motion {
    double distance = 0;
    std::uint32_t joint = 0;
  };
  Motion watch(double seconds, const std::function<void(double t_s)>& each_tick);
  void must_stand_still(double seconds, const std::string& when,
                        const std::function<void(double t_s)>& each_tick);

  std::string newest_line() const;

 private:
  template <class Call>
  wb_status port(Port which, Call&& call);
  static void log(void* user, wb_log_level level, const char* text);

  Options options_;
  Library library_;
  const wb_driver_api* api_;
  wb_driver* driver_ = nullptr;
  wb_description description_{};
  wb_readings readings_{};
  std::array<double, WB_DRIVER_MAX_JOINTS> home_{}, home_effort_{};
  TimeNs period_ns_, timeout_ns_, virtual_ns_ = 0, next_ns_ = 0;
  TimeNs written_ns_ = 0;  // last write, or activate
  std::array<PortUse, kPorts> use_{};
  // ": " and the newest warning or error, for which it waits a little: a plugin's lines come from
  // threads of its own. Empty: there is none.
  std::string why() const;
  mutable std::mutex log_mutex_;
  std::string line_, problem_;  // newest; newest warning or error
};

// The kind by which a joint is held: impedance, position, velocity, torque, the first it supports.
wb_command_kind kind_of(const wb_joint_info& info);

template <class... Parts>
[[noreturn]] void fail(const Parts&... parts) {
  std::string reason;
  const auto add = [&](const auto& part) {
    if constexpr (std::is_convertible_v<decltype(part), std::string>) {
      reason += std::string(part);
    } else if constexpr (std::is_same_v<std::decay_t<decltype(part)>, double>) {
      reason += text_of(part);
    } else if constexpr (std::is_same_v<std::decay_t<decltype(part)>, wb_status>) {
      reason += text_of(part);
    } else {
      reason += std::to_string(part);
    }
  };
  (add(parts), ...);
  throw Failed{reason};
}

}  // namespace wb::check
