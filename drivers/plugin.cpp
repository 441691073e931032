#include "drivers/plugin.hpp"

#include <dlfcn.h>

#include <cstring>
#include <iterator>
#include <stdexcept>

#include "core/types/limits.hpp"

namespace wb {
namespace {

template <std::size_t N>
bool terminated(const char (&name)[N]) {
  return name[0] != '\0' && std::memchr(name, '\0', N) != nullptr;
}

}  // namespace

std::string Plugin::short_name(const std::filesystem::path& library) {
  std::string name = library.stem().string();
  for (const std::string prefix : {"lib", "wb_driver_"}) {
    if (name.size() > prefix.size() && name.starts_with(prefix)) name.erase(0, prefix.size());
  }
  return name;
}

Plugin::Plugin(const PluginSpec& spec, std::string name, wb_log log, void* log_user)
    : name_(std::move(name)) {
  try {
    load(spec.library);
    driver_ = api_->create(spec.config.c_str(), spec.folder.c_str(), log, log_user);
    if (!driver_) throw std::runtime_error("could not be created (its log lines say why)");
    if (api_->configure(driver_) != WB_OK) throw std::runtime_error("could not be configured");
    if (api_->describe(driver_, &description_) != WB_OK)
      throw std::runtime_error("does not describe itself");
    check_description();
    counter_names_ = {"failed_reads", "failed_writes", "joint_faults"};
    diagnostics_ = static_cast<const wb_diagnostics*>(extension(WB_DIAGNOSTICS));
    for (std::uint32_t i = 0; diagnostics_ && i < diagnostics_->count; ++i)
      counter_names_.emplace_back(diagnostics_->names[i]);
    for (std::string& counter : counter_names_) {
      counter = name_ + "." + counter;
      if (counter.size() >= kMaxNameLength)
        throw std::runtime_error("has a counter with too long a name: " + counter + " has " +
                                 std::to_string(counter.size()) + " characters, allowed " +
                                 std::to_string(kMaxNameLength - 1));
    }
  } catch (const std::exception& error) {
    const std::string text = "driver " + spec.library.string() + " " + error.what();
    if (driver_) api_->destroy(driver_);
    if (library_) dlclose(library_);
    throw std::runtime_error(text);
  }
}

Plugin::~Plugin() {
  api_->destroy(driver_);
  dlclose(library_);
}

void Plugin::load(const std::filesystem::path& library) {
  library_ = dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!library_) throw std::runtime_error(std::string("cannot be loaded: ") + dlerror());
  const auto entry = reinterpret_cast<wb_driver_entry_fn>(dlsym(library_, WB_DRIVER_ENTRY));
  if (!entry) throw std::runtime_error("does not export " WB_DRIVER_ENTRY);
  api_ = entry();
  if (!api_) throw std::runtime_error("gives no interface: " WB_DRIVER_ENTRY " returned null");
  if (api_->abi != WB_DRIVER_ABI)
    throw std::runtime_error("has ABI " + std::to_string(api_->abi) + ", this program has " +
                             std::to_string(WB_DRIVER_ABI));
  if (api_->size != sizeof(wb_driver_api))
    throw std::runtime_error("has an interface of " + std::to_string(api_->size) + " bytes, ABI " +
                             std::to_string(WB_DRIVER_ABI) + " has " +
                             std::to_string(sizeof(wb_driver_api)));
}

void Plugin::check_description() const {
  const wb_description& d = description_;
  if (d.joint_count > std::size(d.joints) || d.camera_count > std::size(d.cameras))
    throw std::runtime_error("describes " + std::to_string(d.joint_count) + " joints and " +
                             std::to_string(d.camera_count) + " cameras, more than ABI 1 has");
  for (std::uint32_t i = 0; i < d.joint_count; ++i) {
    if (!terminated(d.joints[i].name))
      throw std::runtime_error("describes joint " + std::to_string(i) + " without a proper name");
  }
  for (std::uint32_t i = 0; i < d.camera_count; ++i) {
    if (!terminated(d.cameras[i].name))
      throw std::runtime_error("describes camera " + std::to_string(i) + " without a proper name");
  }
}

const void* Plugin::extension(const char* extension_name) const {
  return api_->get_extension ? api_->get_extension(driver_, extension_name) : nullptr;
}

void Plugin::read_counters(std::uint64_t* values) const {
  *values++ = failed_reads.load(std::memory_order_relaxed);
  *values++ = failed_writes.load(std::memory_order_relaxed);
  *values++ = joint_faults.load(std::memory_order_relaxed);
  if (diagnostics_) diagnostics_->read(driver_, values);
}

}  // namespace wb
