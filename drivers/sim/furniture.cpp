#include "drivers/sim/furniture.hpp"

#include <cmath>
#include <numbers>

#include "core/types/pose.hpp"

namespace wb::sim {
namespace {

using config::kNonNegative;
using config::kPositive;
using config::Section;
using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr double kPanel_m = 0.018;       // chipboard
constexpr double kGap_m = 0.002;         // around a front, each side
constexpr double kPostRadius_m = 0.005;  // of a handle
constexpr double kPostInset = 0.92;      // posts stand at this fraction of the bar's half length

Isometry3d at(const Vector3d& p) { return Isometry3d(Eigen::Translation3d(p)); }

Solid box(std::string name, const Vector3d& centre, const Vector3d& half, std::string colour) {
  return {std::move(name), Solid::Kind::kBox, half, at(centre), std::move(colour)};
}

// A capsule between two points.
Solid capsule(std::string name, const Vector3d& a, const Vector3d& b, double radius,
              std::string colour) {
  Solid s{std::move(name),
          Solid::Kind::kCapsule,
          {radius, 0.5 * (b - a).norm(), 0},
          at(0.5 * (a + b)),
          std::move(colour)};
  s.X_body.linear() =
      Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), b - a).toRotationMatrix();
  return s;
}

// A flat cylinder whose axis is x.
Solid disc(std::string name, const Vector3d& centre, double radius, double half_length,
           std::string colour) {
  Solid s{std::move(name),
          Solid::Kind::kCylinder,
          {radius, half_length, 0},
          at(centre),
          std::move(colour)};
  s.X_body.linear() = AngleAxisd(0.5 * std::numbers::pi, Vector3d::UnitY()).toRotationMatrix();
  return s;
}

Vector3d box_inertia(double mass_kg, const Vector3d& half) {
  const Vector3d q = half.cwiseAbs2();
  return mass_kg / 3.0 * Vector3d(q.y() + q.z(), q.x() + q.z(), q.x() + q.y());
}

// A moving part's section, with the keys of the run's override (if any) in front.
class Keys {
 public:
  Keys(const Section& scene, const Section* overrides) : scene_(scene), name_(scene.text("name")) {
    if (overrides != nullptr && overrides->has(name_)) override_ = overrides->section(name_);
  }
  const std::string& name() const { return name_; }
  const Section& scene() const { return scene_; }
  double number(const std::string& key, config::Range range) const {
    const double value = scene_.number(key, range);
    return override_ && override_->has(key) ? override_->number(key, range) : value;
  }
  void finish() const {
    scene_.finish();
    if (override_) override_->finish();
  }

 private:
  Section scene_;
  std::string name_;
  std::optional<Section> override_;
};

// What a part must know of the unit around it.
struct Space {
  double width_m = 0, depth_m = 0;
};

PartJoint prismatic(const Keys& k) {
  PartJoint j;
  j.axis = -Vector3d::UnitX();
  j.range = k.number("travel_m", kPositive);
  j.damping = k.number("damping_nspm", kNonNegative);
  j.friction = k.number("friction_n", kNonNegative);
  j.stiffness = k.number("stiffness_npm", kNonNegative);
  j.armature = k.number("armature_kg", kNonNegative);
  return j;
}

PartJoint revolute(const Keys& k, const Vector3d& axis) {
  PartJoint j;
  j.revolute = true;
  j.axis = axis;
  j.range = k.number("range_rad", {0.1, 3.1});
  j.damping = k.number("damping_nmsprad", kNonNegative);
  j.friction = k.number("friction_nm", kNonNegative);
  j.stiffness = k.number("stiffness_nmprad", kNonNegative);
  j.armature = k.number("armature_kgm2", kNonNegative);
  return j;
}

// Puts the handle that the part's section describes on the front at x = face, its bar's centre at
// (y, z) of the body.
void add_handle(Part& part, const Keys& keys, double face, double y, double z, bool vertical) {
  const Section s = keys.scene().section("handle");
  part.handle.length_m = s.number("length_m", kPositive);
  part.handle.radius_m = s.number("radius_m", kPositive);
  const double stand_off = s.number("stand_off_m", kPositive);
  s.finish();
  const Vector3d along = vertical ? Vector3d::UnitZ() : Vector3d::UnitY();
  const Vector3d centre(face - stand_off, y, z);
  part.handle.X_body = at(centre);
  part.handle.X_body.linear().col(0) = along;
  part.handle.X_body.linear().col(1) = Vector3d::UnitX().cross(along);
  part.handle.X_body.linear().col(2) = Vector3d::UnitX();

  const double half = 0.5 * part.handle.length_m;
  part.solids.push_back(capsule(part.name + "/bar", centre - half * along, centre + half * along,
                                part.handle.radius_m, "bar"));
  for (const int side : {-1, 1}) {
    const Vector3d foot = centre + side * kPostInset * half * along;
    part.solids.push_back(capsule(part.name + (side < 0 ? "/post_a" : "/post_b"), foot,
                                  foot + stand_off * Vector3d::UnitX(), kPostRadius_m, "bar"));
  }
  for (std::size_t i = part.solids.size() - 3; i < part.solids.size(); ++i)
    part.solids[i].handle = true;
}

Part build_drawer(const Keys& k, const Space& space) {
  constexpr double kHalfFront = 0.01, kHalfSheet = 0.006, kInset = 0.03;
  Part part;
  part.name = k.name();
  const double bottom = k.number("bottom_m", kNonNegative), top = k.number("top_m", {bottom, 3.0});
  const double height = top - bottom, half_width = 0.5 * space.width_m;
  const std::string colour = k.scene().text("colour");
  part.p_U = {-kHalfFront, 0, 0.5 * (bottom + top)};
  part.joint = prismatic(k);
  part.mass_kg = k.number("mass_kg", kPositive);

  const double half_depth = 0.45 * space.depth_m;  // the box is a little shorter than its carcass
  const double floor_z = -0.5 * height + kInset, half_side = 0.3 * height;
  const double x = half_depth + kHalfFront, y = half_width - kInset;
  part.solids = {box(part.name + "/front", Vector3d::Zero(),
                     {kHalfFront, half_width - kGap_m, 0.5 * height - kGap_m}, colour),
                 box(part.name + "/floor", {x, 0, floor_z}, {half_depth, y, kHalfSheet}, "white"),
                 box(part.name + "/side_a", {x, -y, floor_z + half_side},
                     {half_depth, kHalfSheet, half_side}, "white"),
                 box(part.name + "/side_b", {x, y, floor_z + half_side},
                     {half_depth, kHalfSheet, half_side}, "white"),
                 box(part.name + "/back", {2 * half_depth, 0, floor_z + half_side},
                     {kHalfSheet, y, half_side}, "white")};
  part.com = {0.8 * half_depth, 0, 0};
  part.inertia = box_inertia(part.mass_kg, {half_depth, half_width, 0.5 * height});
  add_handle(part, k, -kHalfFront, 0, k.number("handle_height_m", {bottom, top}) - part.p_U.z(),
             false);
  return part;
}

// A door that falls open: oven (with a window) or dishwasher.
Part build_bottom_door(const Keys& k, const Space& space) {
  constexpr double kHalfDoor = 0.018;
  Part part;
  part.name = k.name();
  const double bottom = k.number("bottom_m", kNonNegative), top = k.number("top_m", {bottom, 3.0});
  const double height = top - bottom, y = 0.5 * space.width_m - kGap_m;
  const std::string colour = k.scene().text("colour");
  part.p_U = {-kHalfDoor - kGap_m, 0, bottom};
  part.joint = revolute(k, -Vector3d::UnitY());
  part.mass_kg = k.number("mass_kg", kPositive);
  const auto slab = [&](const char* name, double y0, double half_y, double z0, double z1) {
    part.solids.push_back(box(part.name + name, {0, y0, 0.5 * (z0 + z1) * height},
                              {kHalfDoor, half_y, 0.5 * (z1 - z0) * height}, colour));
  };
  if (k.scene().boolean("window")) {
    constexpr double kLow = 0.18, kHigh = 0.80, kFrame_m = 0.1;
    slab("/sill", 0, y, 0, kLow);
    slab("/lintel", 0, y, kHigh, 1);
    slab("/frame_a", -y + 0.5 * kFrame_m, 0.5 * kFrame_m, kLow, kHigh);
    slab("/frame_b", y - 0.5 * kFrame_m, 0.5 * kFrame_m, kLow, kHigh);
    part.solids.push_back(box(part.name + "/glass", {0, 0, 0.5 * (kLow + kHigh) * height},
                              {0.01, y - kFrame_m, 0.5 * (kHigh - kLow) * height}, "glass"));
  } else {
    slab("/front", 0, y, 0, 1);
  }
  part.com = {0, 0, 0.5 * height};
  part.inertia = box_inertia(part.mass_kg, {kHalfDoor, y, 0.5 * height});
  add_handle(part, k, -kHalfDoor, 0, k.number("handle_height_m", {bottom, top}) - bottom, false);
  return part;
}

// +1 where the hinge is to the left of who looks at the front, -1 to the right.
int hinge_side(const Keys& k) {
  return k.scene().one_of("hinge", {"left", "right"}) == "left" ? 1 : -1;
}

Part build_side_door(const Keys& k, const Space& space) {
  constexpr double kHalfDoor = 0.01, kHandleInset_m = 0.05;
  Part part;
  part.name = k.name();
  const double bottom = k.number("bottom_m", kNonNegative), top = k.number("top_m", {bottom, 3.0});
  const int side = hinge_side(k);
  const double half_width = 0.5 * space.width_m, half_height = 0.5 * (top - bottom);
  part.p_U = {-kHalfDoor, side * half_width, bottom + half_height};
  part.joint = revolute(k, -side * Vector3d::UnitZ());
  part.mass_kg = k.number("mass_kg", kPositive);
  part.com = {0, -side * half_width, 0};
  const Vector3d half(kHalfDoor, half_width - kGap_m, half_height - kGap_m);
  part.inertia = box_inertia(part.mass_kg, half);
  part.solids = {box(part.name + "/front", part.com, half, k.scene().text("colour"))};
  add_handle(part, k, -kHalfDoor, -side * (space.width_m - kHandleInset_m),
             k.number("handle_height_m", {bottom, top}) - part.p_U.z(), true);
  return part;
}

// The washing machine's round door: a ring of boxes around a pane.
Part build_round_door(const Keys& k, double centre_z) {
  constexpr int kSegments = 12;
  constexpr double kHalfDoor = 0.018, kHalfRing = 0.025, kHingeGap = 0.03, kHandleInset_m = 0.02;
  Part part;
  part.name = k.name();
  const double radius = 0.5 * k.number("diameter_m", {0.2, 0.55});
  const int side = hinge_side(k);
  const double ring = radius - 0.02, centre_y = -side * (radius + kHingeGap);
  part.p_U = {-kHalfDoor - kGap_m, -centre_y, centre_z};
  part.joint = revolute(k, -side * Vector3d::UnitZ());
  part.mass_kg = k.number("mass_kg", kPositive);
  part.com = {0, centre_y, 0};
  part.inertia = box_inertia(part.mass_kg, {kHalfDoor, 0.9 * radius, 0.9 * radius});
  for (int i = 0; i < kSegments; ++i) {
    const double a = 2 * std::numbers::pi * i / kSegments;
    Solid s = box(part.name + "/ring_" + std::to_string(i),
                  {0, centre_y + ring * std::cos(a), ring * std::sin(a)},
                  {kHalfDoor, kHalfRing, ring * std::tan(std::numbers::pi / kSegments)}, "steel");
    s.X_body.linear() = AngleAxisd(a, Vector3d::UnitX()).toRotationMatrix();
    part.solids.push_back(s);
  }
  part.solids.push_back(disc(part.name + "/pane", {0, centre_y, 0}, radius - 0.04, 0.012, "glass"));
  part.solids.push_back(
      box(part.name + "/hinge", {0, -side * 0.02, 0}, {0.012, 0.02, 0.03}, "steel"));
  add_handle(part, k, -kHalfDoor, centre_y - side * (radius - kHandleInset_m), 0, true);
  return part;
}

void add_parts(Unit& unit, const Section& item, const Space& space, const Section* overrides) {
  for (const Section& s : item.sections("parts")) {
    const Keys keys(s, overrides);
    const std::string type = s.one_of("type", {"drawer", "bottom_door", "side_door"});
    unit.parts.push_back(type == "drawer"        ? build_drawer(keys, space)
                         : type == "bottom_door" ? build_bottom_door(keys, space)
                                                 : build_side_door(keys, space));
    keys.finish();
  }
}

void build_carcass(Unit& unit, const Section& item, const Section* overrides) {
  const Space space{item.number("width_m", kPositive), item.number("depth_m", kPositive)};
  const double bottom = item.number("bottom_m", kNonNegative),
               top = item.number("top_m", {bottom, 3.0});
  const double t = 0.5 * kPanel_m, w = 0.5 * space.width_m, d = 0.5 * space.depth_m;
  const double z = 0.5 * (bottom + top), h = 0.5 * (top - bottom);
  const std::string n = unit.name, colour = item.text("colour");
  unit.solids = {box(n + "/side_a", {d, -w + t, z}, {d, t, h}, colour),
                 box(n + "/side_b", {d, w - t, z}, {d, t, h}, colour),
                 box(n + "/floor", {d, 0, bottom + t}, {d, w, t}, colour),
                 box(n + "/top", {d, 0, top - t}, {d, w, t}, colour),
                 box(n + "/back", {2 * d - t, 0, z}, {t, w, h}, colour)};
  if (item.has("control_panel")) {
    const Section s = item.section("control_panel");
    const double low = s.number("bottom_m", {bottom, top}), high = s.number("top_m", {low, top});
    const double centre = 0.5 * (low + high);
    const int knobs = s.integer("knobs", {0, 8});
    unit.solids.push_back(
        box(n + "/panel", {-0.01, 0, centre}, {0.012, w - kGap_m, 0.5 * (high - low)}, "steel"));
    for (int i = 0; i < knobs; ++i) {
      const double y = 0.12 * (i - 0.5 * (knobs - 1));
      unit.solids.push_back(
          disc(n + "/knob_" + std::to_string(i), {-0.03, y, centre}, 0.018, 0.012, "black"));
    }
    s.finish();
  }
  add_parts(unit, item, space, overrides);
}

void build_washing_machine(Unit& unit, const Section& item, const Section* overrides) {
  const double w = 0.5 * item.number("width_m", {0.55, 1.0}),
               depth = item.number("depth_m", kPositive);
  const double top = item.number("top_m", {0.7, 1.2}),
               door_z = item.number("door_centre_m", {0.3, 0.6});
  constexpr double kSheet = 0.01, kHole = 0.2;  // half thickness; half side of the door's opening
  const double d = 0.5 * depth, z = 0.5 * top;
  const std::string n = unit.name, colour = item.text("colour");
  const double above = 0.5 * (top - door_z - kHole), below = 0.5 * (door_z - kHole);
  unit.solids = {box(n + "/side_a", {d, -w + kSheet, z}, {d, kSheet, z}, colour),
                 box(n + "/side_b", {d, w - kSheet, z}, {d, kSheet, z}, colour),
                 box(n + "/top", {d, 0, top - kSheet}, {d, w, kSheet}, colour),
                 box(n + "/back", {depth - kSheet, 0, z}, {kSheet, w, z}, colour),
                 box(n + "/front_top", {kSheet, 0, top - above}, {kSheet, w, above}, colour),
                 box(n + "/front_bottom", {kSheet, 0, below}, {kSheet, w, below}, colour),
                 box(n + "/front_a", {kSheet, -0.5 * (w + kHole), door_z},
                     {kSheet, 0.5 * (w - kHole), kHole}, colour),
                 box(n + "/front_b", {kSheet, 0.5 * (w + kHole), door_z},
                     {kSheet, 0.5 * (w - kHole), kHole}, colour),
                 disc(n + "/knob", {0, 0.2, top - above}, 0.025, 0.012, "steel"),
                 box(n + "/display", {-0.003, -0.15, top - above}, {0.003, 0.09, 0.04}, "black")};
  const Keys keys(item.section("door"), overrides);
  unit.parts.push_back(build_round_door(keys, door_z));
  keys.finish();
}

void build_box(Unit& unit, const Section& item) {
  const Vector3d size = item.vector3("size_m");
  const double bottom = item.number("bottom_m", kNonNegative);
  unit.solids = {
      box(unit.name + "/box", {0, 0, bottom + 0.5 * size.z()}, 0.5 * size, item.text("colour"))};
}

void add_legs(Unit& unit, double x, double y, double top, double half, const std::string& colour) {
  int i = 0;
  for (const int a : {-1, 1}) {
    for (const int b : {-1, 1}) {
      unit.solids.push_back(box(unit.name + "/leg_" + std::to_string(i++),
                                {a * x, b * y, 0.5 * top}, {half, half, 0.5 * top}, colour));
    }
  }
}

void build_table(Unit& unit, const Section& item) {
  constexpr double kHalfTop = 0.02, kHalfLeg = 0.025, kLegInset = 0.05;
  const Vector3d half = 0.5 * item.vector3("size_m");
  const double height = 2 * half.z();
  const std::string colour = item.text("colour");
  unit.solids = {
      box(unit.name + "/top", {0, 0, height - kHalfTop}, {half.x(), half.y(), kHalfTop}, colour)};
  add_legs(unit, half.x() - kLegInset, half.y() - kLegInset, height - 2 * kHalfTop, kHalfLeg,
           colour);
}

void build_chair(Unit& unit, const Section& item) {  // seat and legs; the back stands at x = -0.19
  constexpr double kHalfSeat = 0.2, kSeat = 0.45;
  const std::string colour = item.text("colour");
  unit.solids = {box(unit.name + "/seat", {0, 0, kSeat}, {kHalfSeat, kHalfSeat, 0.015}, colour),
                 box(unit.name + "/back", {-0.19, 0, 0.7}, {0.015, kHalfSeat, 0.25}, colour)};
  add_legs(unit, 0.18, 0.18, kSeat - 0.015, 0.018, colour);
}

}  // namespace

Unit build_unit(const Section& item, const Section* overrides) {
  Unit unit;
  unit.name = item.text("name");
  const std::vector<double> place = item.numbers("x_y_yaw", 3);
  unit.X_SU = planar_isometry(place[0], place[1], place[2]);
  const std::string type =
      item.one_of("type", {"carcass", "washing_machine", "box", "table", "chair"});
  if (type == "carcass") build_carcass(unit, item, overrides);
  if (type == "washing_machine") build_washing_machine(unit, item, overrides);
  if (type == "box") build_box(unit, item);
  if (type == "table") build_table(unit, item);
  if (type == "chair") build_chair(unit, item);
  item.finish();
  return unit;
}

}  // namespace wb::sim
