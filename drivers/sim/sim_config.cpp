#include "drivers/sim/sim_config.hpp"

#include <algorithm>

namespace wb::sim {
namespace {

using config::kNonNegative;
using config::kPositive;
using config::Section;

std::array<double, 3> friction(const Section& s) {
  const std::vector<double> v = s.numbers("friction", 3, kPositive);
  return {v[0], v[1], v[2]};
}

// One number for each joint of the robot, by name.
std::vector<double> by_joint(const Section& root, const std::string& key,
                             const RobotConfig& robot) {
  const Section s = root.section(key);
  std::vector<double> out;
  for (const JointConfig& joint : robot.joints) out.push_back(s.number(joint.name, kNonNegative));
  s.finish();
  return out;
}

std::vector<double> load_posture(const Section& spawn, const RobotConfig& robot) {
  if (!spawn.has("posture")) return robot.stowed;
  if (!spawn.is_scalar("posture"))
    return spawn.numbers("posture", static_cast<int>(robot.joints.size()));
  return spawn.one_of("posture", {"stowed", "ready"}) == "stowed" ? robot.stowed : robot.ready;
}

}  // namespace

RobotSimConfig RobotSimConfig::load(const RobotConfig& robot) {
  const Section root = Section::open(robot.folder / "sim.yaml");
  RobotSimConfig sim;
  const int step_us = root.integer("step_us", {100, 2500});
  if (2500 % step_us != 0) root.fail("step_us", "must divide 2500, the control period");
  sim.step_ns = step_us * TimeNs{1000};
  const bool drives = robot.base.kind != BaseKind::kFixed;
  // A base that drives needs one: its heading is the gyro's.
  if (drives || root.has("imu")) sim.imu = root.text("imu");
  if (root.has("wrench_link")) sim.wrench_link = root.text("wrench_link");

  const std::vector<double> armature = by_joint(root, "armature_kgm2", robot);
  const std::vector<double> stiffness = by_joint(root, "hold_nmprad", robot);
  const std::vector<double> damping = by_joint(root, "hold_nmsprad", robot);
  const std::vector<double> damped = by_joint(root, "damped_nmsprad", robot);
  for (std::size_t i = 0; i < armature.size(); ++i) {
    sim.joints.push_back({armature[i], stiffness[i], damping[i], damped[i]});
  }

  if (drives) {
    const Section wheels = root.section("wheels");
    sim.wheels.armature = wheels.number("armature_kgm2", kNonNegative);
    sim.wheels.servo_damping = wheels.number("servo_nmsprad", kPositive);
    sim.wheels.brake_stiffness = wheels.number("brake_nmprad", kPositive);
    sim.wheels.brake_damping = wheels.number("brake_nmsprad", kPositive);
    if (robot.base.kind == BaseKind::kOmnidirectional) {
      sim.wheels.roller_slip_nspm = wheels.number("roller_slip_nspm", kPositive);
      sim.wheels.roller_friction = wheels.number("roller_friction", kPositive);
    } else {
      sim.wheels.friction = friction(wheels);
    }
    wheels.finish();
  }
  if (root.has("castors")) {
    const Section castors = root.section("castors");
    sim.castors = {castors.texts("collisions"), friction(castors)};
    castors.finish();
  }
  if (!robot.fingers.empty()) {
    const Section gripper = root.section("gripper");
    sim.gripper = {gripper.number("armature_kg", kNonNegative),
                   gripper.number("servo_npm", kPositive),
                   gripper.number("servo_nspm", kNonNegative),
                   gripper.number("speed_mps", kPositive),
                   gripper.number("force_max_n", kPositive),
                   gripper.texts("pads"),
                   friction(gripper)};
    gripper.finish();
  }
  const Section colours = root.section("colours");
  for (const std::string& link : colours.keys()) {
    const std::vector<double> rgb = colours.numbers(link, 3, config::kFraction);
    sim.colours[link] = {rgb[0], rgb[1], rgb[2]};
  }
  if (!sim.colours.contains("default")) root.fail("colours", "lacks 'default'");
  root.finish();
  return sim;
}

PluginConfig PluginConfig::parse(const std::string& text, const std::filesystem::path& folder) {
  const Section root = Section::parse(text, (folder / "plugin sim").string());
  PluginConfig config;
  config.robot = RobotConfig::load(root.file("robot"));
  config.sim = RobotSimConfig::load(config.robot);
  if (root.has("objects")) {
    const Section objects = root.section("objects");
    config.scene = Scene::load(root.file("scene"), &objects);
  } else {
    config.scene = Scene::load(root.file("scene"), nullptr);
  }
  config.seed = static_cast<std::uint64_t>(root.integer("seed", {0, 2e9}));
  config.posture = config.robot.stowed;
  if (root.is_scalar("spawn")) {
    root.one_of("spawn", {"random"});
  } else {
    const Section spawn = root.section("spawn");
    config.spawn = Spawn{spawn.number("x_m"), spawn.number("y_m"), spawn.number("yaw_rad")};
    config.posture = load_posture(spawn, config.robot);
    spawn.finish();
  }
  config.colour = root.boolean_or("colour", false);
  config.render_thread = root.boolean_or("render_thread", false);
  root.finish();
  return config;
}

}  // namespace wb::sim
