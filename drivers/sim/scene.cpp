#include "drivers/sim/scene.hpp"

#include <set>

#include "drivers/sim/furniture.hpp"

namespace wb::sim {
namespace {

using config::kFraction;
using config::kNonNegative;
using config::Section;

std::array<double, 2> interval(const Section& s, const std::string& key) {
  const std::vector<double> v = s.numbers(key, 2);
  if (v[0] >= v[1]) s.fail(key, "must be a lower and a higher bound");
  return {v[0], v[1]};
}

NoiseConfig load_noise(const Section& s) {
  NoiseConfig noise;
  noise.depth_per_m = s.number("depth_m_per_m2", kNonNegative);
  noise.depth_dropout = s.number("depth_dropout_fraction", kFraction);
  noise.camera_delay_s = s.number("camera_delay_s", kNonNegative);
  noise.encoder_rad = s.number("encoder_rad", kNonNegative);
  noise.encoder_radps = s.number("encoder_radps", kNonNegative);
  noise.effort_nm = s.number("effort_nm", kNonNegative);
  noise.gyro_radps = s.number("gyro_radps", kNonNegative);
  noise.gyro_walk_radps = s.number("gyro_walk_radps_per_sqrt_s", kNonNegative);
  noise.accelerometer_mps2 = s.number("accelerometer_mps2", kNonNegative);
  noise.wrench_n = s.number("wrench_n", kNonNegative);
  noise.wrench_nm = s.number("wrench_nm", kNonNegative);
  noise.gripper_m = s.number("gripper_m", kNonNegative);
  noise.gripper_n = s.number("gripper_n", kNonNegative);
  s.finish();
  return noise;
}

ViewConfig load_view(const Section& s) {
  ViewConfig view;
  view.position = s.vector3("position_m");
  view.target = s.vector3("target_m");
  view.width_rad = s.number("width_rad", {0.1, 2.5});
  s.finish();
  return view;
}

// Names end up in C structs of 32 characters, and colours must exist.
void check(const Section& file, const Scene& scene) {
  std::set<std::string> names;
  const auto check_name = [&](const std::string& name) {
    if (name.size() > 31)
      file.fail("items", "holds the name '" + name + "', which is longer than 31 characters");
    if (!names.insert(name).second) file.fail("items", "holds the name '" + name + "' twice");
  };
  const auto check_solid = [&](const Solid& solid) {
    check_name(solid.name);
    if (!scene.colours.contains(solid.colour)) {
      file.fail("colours",
                "lacks the colour '" + solid.colour + "' that '" + solid.name + "' asks for");
    }
  };
  for (const Unit& unit : scene.units) {
    check_name(unit.name);
    for (const Solid& solid : unit.solids) check_solid(solid);
    for (const Part& part : unit.parts) {
      check_name(part.name);
      for (const Solid& solid : part.solids) check_solid(solid);
    }
  }
}

}  // namespace

Eigen::Vector3d Solid::extent() const {
  switch (kind) {
    case Kind::kBox:
      return half;
    case Kind::kCapsule:
      return {half[0], half[0], half[1] + half[0]};
    case Kind::kCylinder:
      return {half[0], half[0], half[1]};
  }
  return half;
}

Scene Scene::load(const std::filesystem::path& file, const Section* overrides) {
  const Section root = Section::open(file);
  Scene scene;
  scene.name = root.text("name");
  const Section floor = root.section("floor");
  scene.floor_x_m = interval(floor, "x_m");
  scene.floor_y_m = interval(floor, "y_m");
  floor.finish();
  const Section colours = root.section("colours");
  for (const std::string& name : colours.keys()) {
    const std::vector<double> rgb = colours.numbers(name, 3, kFraction);
    scene.colours[name] = {rgb[0], rgb[1], rgb[2]};
  }
  if (!scene.colours.contains("floor")) root.fail("colours", "lacks the colour 'floor'");
  for (const Section& item : root.sections("items")) {
    scene.units.push_back(build_unit(item, overrides));
  }
  if (overrides != nullptr) overrides->finish();
  scene.noise = load_noise(root.section("noise"));
  scene.view = load_view(root.section("view"));
  scene.light = root.vector3("light_m");
  root.finish();
  check(root, scene);
  return scene;
}

}  // namespace wb::sim
