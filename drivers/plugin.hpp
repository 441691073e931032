// One loaded driver plugin: its library, its instance, what it describes, its counters. Setup world
// but for read_counters (any thread).
#pragma once
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "drivers/driver.h"

namespace wb {

struct PluginSpec {
  std::filesystem::path library;
  std::string config;            // text of its YAML section
  std::filesystem::path folder;  // what file names in it are relative to
  // How its joints (not its wheels) are commanded; NONE: the first of impedance, position, torque
  // that a joint supports.
  wb_command_kind command = WB_CMD_NONE;
};

class Plugin {
 public:
  // Loads, creates, configures. `name` stands for the plugin in errors and counters. Throws
  // std::runtime_error naming plugin and cause: no such library, another ABI number or size of the
  // interface (both named), a failed create or configure, a description that cannot be.
  Plugin(const PluginSpec& spec, std::string name, wb_log log, void* log_user);
  ~Plugin();
  Plugin(const Plugin&) = delete;
  Plugin& operator=(const Plugin&) = delete;

  // "can" of libwb_driver_can.so.
  static std::string short_name(const std::filesystem::path& library);

  const wb_driver_api& api() const { return *api_; }
  wb_driver* get() const { return driver_; }
  const wb_description& description() const { return description_; }
  const std::string& name() const { return name_; }
  const void* extension(const char* extension_name) const;

  // The host's own counters of this plugin, then those of its extension "wb.diagnostics/1".
  const std::vector<std::string>& counter_names() const { return counter_names_; }
  void read_counters(std::uint64_t* values) const;

  std::atomic<std::uint64_t> failed_reads{0}, failed_writes{0}, joint_faults{0};

 private:
  void load(const std::filesystem::path& library);
  void check_description() const;

  std::string name_;
  void* library_ = nullptr;
  const wb_driver_api* api_ = nullptr;
  wb_driver* driver_ = nullptr;
  wb_description description_{};
  const wb_diagnostics* diagnostics_ = nullptr;
  std::vector<std::string> counter_names_;
};

}  // namespace wb
