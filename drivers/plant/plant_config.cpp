#include "drivers/plant/plant_config.hpp"

#include "core/config/config.hpp"

namespace wb::plant {
namespace {

using config::Section;

// The CAN plugin's section of the daemon's file: both sides of the bus read the same lines.
can::PluginConfig can_section(const Section& plant, const std::string& key) {
  const std::filesystem::path file = plant.file(key);
  const Section daemon = Section::open(file);
  for (const Section& driver : daemon.sections("drivers")) {
    if (std::filesystem::path(driver.text("plugin")).filename() == "libwb_driver_can.so")
      return can::PluginConfig::parse(driver.block("config"), file.parent_path());
  }
  plant.fail(key, file.string() + " has no driver libwb_driver_can.so");
}

}  // namespace

Config Config::load(const std::filesystem::path& file) {
  const Section root = Section::open(file);
  Config out;
  out.folder = file.parent_path();
  out.sim = root.block("sim");
  if (root.has("can")) out.can = can_section(root, "can");
  if (root.has("gripper")) {
    const Section s = root.section("gripper");
    out.gripper_port = out.folder / s.text("port");
    out.gripper_opening_max_m = s.number("opening_max_m", {0.01, 0.2});
    s.finish();
  }
  if (root.has("dds")) {
    const Section s = root.section("dds");
    DdsOptions d;
    d.prefix = s.text("prefix");
    d.domain = s.integer("domain", {0, 232});
    d.paced = s.boolean("paced");
    d.truth = s.boolean_or("truth", true);
    d.joints = d.advances = !out.can;
    d.gripper = out.gripper_port.empty();
    if (out.can && out.can->paced() != d.paced)
      s.fail("paced", "CAN and DDS must both be paced, or neither");
    s.finish();
    out.dds = d;
  }
  if (!out.can && !out.dds) root.fail("dds", "there must be a bus: can, dds or both");
  root.finish();
  return out;
}

}  // namespace wb::plant
