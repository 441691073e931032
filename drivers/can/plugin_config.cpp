#include "drivers/can/plugin_config.hpp"

#include <algorithm>
#include <cstdio>
#include <set>

#include "core/config/config.hpp"
#include "drivers/can/bus_load.hpp"

namespace wb::can {
namespace {

using config::Range;
using config::Section;

int integer_or(const Section& s, const std::string& key, int otherwise, Range range) {
  return s.has(key) ? s.integer(key, range) : otherwise;
}

// Decimal or, as data sheets have it, hexadecimal with 0x.
std::uint32_t number32(const Section& s, const std::string& key) {
  if (!s.has(key)) return 0;
  const std::string text = s.text(key);
  std::size_t used = 0;
  unsigned long value = 0;
  try {
    value = std::stoul(text, &used, 0);
  } catch (const std::exception&) {
  }
  if (used == 0 || used != text.size() || text[0] == '-' || value > 0xFFFFFFFFul)
    s.fail(key, "must be a whole number from 0 to 0xFFFFFFFF, is '" + text + "'");
  return static_cast<std::uint32_t>(value);
}

Supervision parse_supervision(const Section& s) {
  Supervision d;
  const Range count{1, 1000}, ms{1, 60000};
  d.velocity_every = integer_or(s, "velocity_every", d.velocity_every, {1, 240});
  d.tpdo_lost_max = integer_or(s, "tpdo_lost_max", d.tpdo_lost_max, count);
  d.tpdo_window = s.number_or("tpdo_window", d.tpdo_window, {0.1, 1});
  d.duplicates_max = integer_or(s, "duplicates_max", d.duplicates_max, count);
  d.refused_max = integer_or(s, "refused_max", d.refused_max, count);
  d.heartbeat_ms = integer_or(s, "heartbeat_ms", d.heartbeat_ms, ms);
  d.heartbeat_lost_ms = integer_or(s, "heartbeat_lost_ms", d.heartbeat_lost_ms, ms);
  d.rpdo_timeout_ms = integer_or(s, "rpdo_timeout_ms", d.rpdo_timeout_ms, ms);
  d.sdo_timeout_ms = integer_or(s, "sdo_timeout_ms", d.sdo_timeout_ms, ms);
  d.setup_timeout_ms = integer_or(s, "setup_timeout_ms", d.setup_timeout_ms, ms);
  d.enable_timeout_ms = integer_or(s, "enable_timeout_ms", d.enable_timeout_ms, ms);
  d.following_ms = integer_or(s, "following_ms", d.following_ms, ms);
  d.reset_attempts = integer_or(s, "reset_attempts", d.reset_attempts, {0, 100});
  d.bus_off_max = integer_or(s, "bus_off_max", d.bus_off_max, {0, 1000});
  d.command_age_ms = integer_or(s, "command_age_ms", d.command_age_ms, ms);
  d.master_id = integer_or(s, "master_id", d.master_id, {1, 127});
  if (d.heartbeat_lost_ms < 2 * d.heartbeat_ms)
    s.fail("heartbeat_lost_ms", "must be at least twice heartbeat_ms");
  s.finish();
  return d;
}

BusConfig parse_bus(const Section& s, const std::filesystem::path& folder) {
  BusConfig b;
  b.name = s.text("name");
  b.type = s.one_of("type", {"socketcan", "unix"}) == "unix" ? BusConfig::Type::kUnix
                                                             : BusConfig::Type::kSocketCan;
  if (b.type == BusConfig::Type::kUnix) {
    b.path = folder / s.text("path");
    b.paced = s.boolean_or("paced", false);
  } else {
    b.interface = s.text("interface");
  }
  b.bit_rate = s.number("bit_rate", {10e3, 1e6});
  b.priority = integer_or(s, "priority", 0, {0, 98});
  s.finish();
  return b;
}

DriveConfig parse_drive(const Section& s, const std::vector<BusConfig>& buses) {
  DriveConfig d;
  d.joint = s.text("joint");
  if (d.joint.size() > 31) s.fail("joint", "a name has at most 31 characters");
  std::vector<std::string> names;
  for (const BusConfig& b : buses) names.push_back(b.name);
  const std::string bus = s.one_of("bus", names);
  d.bus = static_cast<int>(std::find(names.begin(), names.end(), bus) - names.begin());
  d.node_id = s.integer("node", {1, 127});
  d.wheel = s.boolean_or("wheel", false);
  const std::string mode = s.one_of("mode", {"csp", "csv", "cst"});
  d.mode = mode == "csp" ? DriveMode::kCsp : mode == "csv" ? DriveMode::kCsv : DriveMode::kCst;
  d.scale.counts_per_unit = s.number("counts_per_rad", config::kPositive);
  d.scale.sign = s.number_or("sign", 1);
  if (d.scale.sign != 1 && d.scale.sign != -1) s.fail("sign", "must be 1 or -1");
  d.scale.offset = s.number_or("offset_rad", 0);
  d.scale.torque_per_permille = s.number("torque_per_permille_nm", config::kPositive);
  d.position_min = s.number_or("position_min_rad", 0);
  d.position_max = s.number_or("position_max_rad", 0);
  if (d.position_max < d.position_min) s.fail("position_max_rad", "lies below position_min_rad");
  d.velocity_max = s.number("velocity_max_radps", config::kPositive);
  d.effort_max = s.number("effort_max_nm", config::kPositive);
  d.following_max =
      s.number_or(d.mode == DriveMode::kCsv ? "following_max_radps" : "following_max_rad", 0,
                  config::kNonNegative);
  d.quick_stop_decel = s.number_or("quick_stop_decel_radps2", 0, config::kNonNegative);
  d.device_type = number32(s, "device_type");
  d.vendor = number32(s, "vendor");
  d.product = number32(s, "product");
  d.revision = number32(s, "revision");
  d.serial = number32(s, "serial");
  s.finish();
  return d;
}

}  // namespace

PluginConfig PluginConfig::parse(const std::string& text, const std::filesystem::path& folder) {
  const Section root = Section::parse(text, "CAN plugin");
  PluginConfig c;
  const double rate_hz = root.number("sync_rate_hz", {1, 2000});
  if (root.has("supervision")) c.supervision = parse_supervision(root.section("supervision"));
  c.supervision.sync_rate_hz = rate_hz;
  c.bus_load_max = root.number_or("bus_load_max", c.bus_load_max, {0.01, 1});
  c.pace_timeout_ms = integer_or(root, "pace_timeout_ms", c.pace_timeout_ms, {1, 60000});
  for (const Section& s : root.sections("buses")) c.buses.push_back(parse_bus(s, folder));
  for (const Section& s : root.sections("drives")) {
    c.drives.push_back(parse_drive(s, c.buses));
    const DriveConfig& d = c.drives.back();
    if (d.node_id == c.supervision.master_id) s.fail("node", "is the master's own id");
    for (std::size_t i = 0; i + 1 < c.drives.size(); ++i) {
      if (c.drives[i].joint == d.joint) s.fail("joint", "'" + d.joint + "' stands twice");
      if (c.drives[i].bus == d.bus && c.drives[i].node_id == d.node_id)
        s.fail("node", "bus " + c.buses[static_cast<std::size_t>(d.bus)].name +
                           " has two drives with this id");
    }
  }
  if (c.buses.empty()) root.fail("buses", "at least one is needed");
  if (c.drives.empty() || c.drives.size() > 32) root.fail("drives", "1 to 32 are allowed");
  for (const BusConfig& b : c.buses) {
    if (b.paced != c.paced()) root.fail("buses", "all are paced, or none");
  }
  root.finish();
  for (std::size_t i = 0; i < c.buses.size(); ++i) {
    std::vector<DriveMode> modes;
    for (const DriveConfig& d : c.drives) {
      if (d.bus == static_cast<int>(i)) modes.push_back(d.mode);
    }
    BusConfig& b = c.buses[i];
    b.load = bus_load(modes, c.supervision, b.bit_rate);
    if (b.load <= c.bus_load_max) continue;
    std::vector<DriveMode> fits = modes;
    while (!fits.empty() && bus_load(fits, c.supervision, b.bit_rate) > c.bus_load_max)
      fits.pop_back();
    char line[256];
    std::snprintf(line, sizeof line,
                  "bus %s would be overloaded: %zu drives with 1 RPDO and %s at %.0f Hz need up to "
                  "%.0f %% of %.0f kbit/s (worst-case stuffing, heartbeats included), allowed are "
                  "%.0f %%: at most %zu drives",
                  b.name.c_str(), modes.size(),
                  c.supervision.velocity_every == 1 ? "2 TPDOs" : "1 to 2 TPDOs", rate_hz,
                  100 * b.load, 1e-3 * b.bit_rate, 100 * c.bus_load_max, fits.size());
    root.fail("buses", line);
  }
  return c;
}

}  // namespace wb::can
