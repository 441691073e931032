#include "daemon/daemon_config.hpp"

#include <sstream>

namespace wb {
namespace {

LoopConfig loop(const config::Section& loops, const std::string& name) {
  const config::Section s = loops.section(name);
  LoopConfig out;
  out.rate_hz = s.number("rate_hz", config::kPositive);
  out.latency_ns = from_seconds(1e-3 * s.number_or("latency_ms", 0.0, config::kNonNegative));
  out.priority = s.has("priority") ? s.integer("priority", {0, 98}) : 0;
  s.finish();
  return out;
}

}  // namespace

DaemonConfig DaemonConfig::load(const std::filesystem::path& file,
                                const std::filesystem::path& plugin_folder) {
  return from(config::Section::open(file), file.parent_path(), plugin_folder);
}

DaemonConfig DaemonConfig::from(const config::Section& root, const std::filesystem::path& folder,
                                const std::filesystem::path& plugin_folder) {
  DaemonConfig out;
  out.robot = folder / root.text("robot");
  for (const config::Section& d : root.sections("drivers")) {
    PluginSpec spec;
    const std::filesystem::path plugin = d.text("plugin");
    spec.library = plugin.has_parent_path() ? folder / plugin : plugin_folder / plugin;
    spec.folder = folder;
    spec.config = d.block("config");
    if (d.has("command")) {
      const std::string kind = d.one_of("command", {"impedance", "position", "torque"});
      spec.command = kind == "impedance"  ? WB_CMD_IMPEDANCE
                     : kind == "position" ? WB_CMD_POSITION
                                          : WB_CMD_TORQUE;
    }
    d.finish();
    out.drivers.push_back(std::move(spec));
  }
  out.interpreter = root.one_of("interpreter", {"oracle", "none"});
  out.seed = static_cast<std::uint64_t>(root.integer("seed", config::kNonNegative));
  const config::Section loops = root.section("loops");
  out.control = loop(loops, "control");
  out.mpc = loop(loops, "mpc");
  out.frames = loop(loops, "frames");
  out.mapping = loop(loops, "mapping");
  out.perception = loop(loops, "perception");
  loops.finish();
  out.command_timeout_ns =
      from_seconds(1e-3 * root.number("command_timeout_ms", config::kPositive));
  if (root.has("disabled_terms")) out.disabled_terms = root.texts("disabled_terms");
  root.finish();
  return out;
}

}  // namespace wb
