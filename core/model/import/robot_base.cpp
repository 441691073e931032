// find_base: which links are wheels, what they make of the base, and where B is.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <sstream>

#include "core/model/import/robot_structure.hpp"

namespace wb {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

struct Wheel {
  std::string joint;
  int line = 0;
  Vector3d centre, axis;  // in the root
  double radius = 0;
};

// Furthest point of a link's shapes from a line, and the lowest of all points.
double radius_about(const UrdfLink& link, const Vector3d& axis_L) {
  double r = 0;
  for (const UrdfCollision& c : link.collisions) {
    for (const Vector3d& p : c.solid.surface(0.01))
      r = std::max(r, (p - p.dot(axis_L) * axis_L).norm());
  }
  return r;
}

// A root that only carries dummy joints is dropped: what stays begins at the link they move.
class DummyChain {
 public:
  explicit DummyChain(UrdfDocument& document) : document_(document) {}

  std::string note;
  bool planar = false, floating = false;

  void strip() {
    std::vector<const UrdfJoint*> movable;
    std::string link = document_.root;
    while (hollow(link)) {
      const auto below = document_.joints_below(link);
      if (below.size() != 1) break;
      if (below[0]->movable()) movable.push_back(below[0]);
      link = below[0]->child;
    }
    const auto type = [&](std::size_t i) { return movable[i]->type; };
    using Type = UrdfJoint::Type;
    if (movable.size() == 1 && (type(0) == Type::kPlanar || type(0) == Type::kFloating)) {
      planar = type(0) == Type::kPlanar;
      floating = !planar;
      drop_above(movable[0]->child);
      note = std::string("a ") + (planar ? "planar" : "floating") + " joint from a dummy root";
    } else if (movable.size() >= 3 && type(0) == Type::kPrismatic && type(1) == Type::kPrismatic &&
               movable[2]->turns()) {
      const auto poses = document_.poses();
      const auto axis = [&](std::size_t i) -> Vector3d {
        return poses.at(movable[i]->child).linear() * movable[i]->axis;
      };
      const bool level = std::abs(axis(0).z()) < 0.01 && std::abs(axis(1).z()) < 0.01 &&
                         std::abs(axis(0).dot(axis(1))) < 0.01 && std::abs(axis(2).z()) > 0.99;
      if (!level) return;
      planar = true;
      note = "the dummy joints " + movable[0]->name + ", " + movable[1]->name + ", " +
             movable[2]->name;
      drop_above(movable[2]->child);
    }
  }

 private:
  // No shapes, and no more mass than dummies are given.
  bool hollow(const std::string& name) const {
    const UrdfLink& link = document_.link(name);
    return link.collisions.empty() && (!link.inertial || link.inertial->mass <= 1.0);
  }
  void drop_above(std::string link) {  // by value: the joints that may hold it go
    const UrdfDocument before = document_;
    std::erase_if(document_.joints,
                  [&](const UrdfJoint& j) { return !before.is_below(j.parent, link); });
    std::erase_if(document_.links,
                  [&](const UrdfLink& l) { return !before.is_below(l.name, link); });
    document_.root = link;
  }

  UrdfDocument& document_;
};

std::vector<Wheel> find_wheels(const UrdfDocument& document) {
  std::vector<Wheel> out;
  const auto poses = document.poses();
  for (const UrdfJoint& j : document.joints) {
    if (j.type != UrdfJoint::Type::kContinuous) continue;
    bool on_the_base = true, leaf = true;
    for (const UrdfJoint* up : document.path_to(j.parent)) on_the_base &= !up->movable();
    for (const UrdfJoint& other : document.joints)
      leaf &= &other == &j || !other.movable() || !document.is_below(other.parent, j.child);
    const Isometry3d& X = poses.at(j.child);
    const Vector3d axis = X.linear() * j.axis;
    if (!on_the_base || !leaf || std::abs(axis.z()) > 0.05) continue;
    out.push_back(
        {j.name, j.line, X.translation(), axis, radius_about(document.link(j.child), j.axis)});
  }
  // Wheels stand on one floor: an arm's roll joint does not.
  double floor = 1e9;
  for (const Wheel& w : out) floor = std::min(floor, w.centre.z() - w.radius);
  std::erase_if(out, [&](const Wheel& w) { return w.centre.z() - w.radius > floor + 0.03; });
  return out.size() >= 2 ? out : std::vector<Wheel>{};
}

// Lowest point of everything rigid with the root.
double lowest(const UrdfDocument& document, const std::vector<Vector3d>& points) {
  double z = points.empty() ? 0 : 1e9;
  for (const Vector3d& p : points) z = std::min(z, p.z());
  return z;
}

std::vector<Vector3d> base_surface(const UrdfDocument& document) {
  std::vector<Vector3d> out;
  const auto poses = document.poses();
  for (const UrdfLink& link : document.links) {
    bool rigid = true;
    for (const UrdfJoint* j : document.path_to(link.name)) rigid &= !j->movable();
    if (!rigid) continue;
    for (const UrdfCollision& c : link.collisions) {
      for (const Vector3d& p : c.solid.surface(0.05)) out.push_back(poses.at(link.name) * p);
    }
  }
  return out;
}

std::string add_wheel(UrdfDocument& document, const std::string& name, const Vector3d& at,
                      double radius, double width) {
  Isometry3d X = Isometry3d::Identity();
  X.translation() = at;
  const std::string link = add_frame(document, name + "_link", document.root, X);
  UrdfCollision c;
  c.name = name;
  c.solid.kind = Solid::Kind::kCylinder;
  c.solid.half = {radius, radius, 0.5 * width};
  c.solid.X_LS.linear() = Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitX()).matrix();
  document.link(link).collisions.push_back(c);
  UrdfInertial in;
  in.mass = 4;
  in.inertia.diagonal() =
      in.mass * Vector3d(0.25 * radius * radius, 0.5 * radius * radius, 0.25 * radius * radius);
  document.link(link).inertial = in;
  UrdfJoint& joint = document.joints.back();
  joint.name = link.substr(0, link.size() - 5);
  joint.type = UrdfJoint::Type::kContinuous;
  joint.axis = Vector3d::UnitY();
  joint.limit = UrdfLimit{0, 0, 10.0, 50.0};
  joint.damping = 0.5;
  return joint.name;
}

// Wheels that the URDF leaves out: beside the base's shapes.
std::vector<Wheel> invent_wheels(UrdfDocument& document, ImportedBase base, RobotStructure& out) {
  const std::vector<Vector3d> surface = base_surface(document);
  const auto [low, high] =
      surface.empty() ? std::array<Vector3d, 2>{Vector3d(-0.3, -0.25, 0), Vector3d(0.3, 0.25, 0.3)}
                      : bounds(surface);
  constexpr double kRadius_m = 0.1, kWidth_m = 0.04;
  const double half = std::max(std::abs(low.y()), high.y()) + 0.5 * kWidth_m + 1e-3;
  const double z = low.z() + (low.z() > -1e-3 ? kRadius_m : 0.0);
  const bool four = base == ImportedBase::kOmnidirectional;
  const double front = four ? high.x() - kRadius_m : 0, rear = four ? low.x() + kRadius_m : 0;
  for (const double x : four ? std::vector<double>{front, rear} : std::vector<double>{0.0}) {
    for (const double side : {1.0, -1.0}) {
      const std::string name = std::string("wheel_") +
                               (four ? x == front ? "front_" : "rear_" : "") +
                               (side > 0 ? "left" : "right");
      add_wheel(document, name, {x, side * half, z}, kRadius_m, kWidth_m);
    }
  }
  out.notes.push_back("wheels: the URDF has none, " + std::string(four ? "four" : "two") +
                      " of 0.10 m radius and 4 kg are invented beside the base's shapes; put in "
                      "yours");
  return find_wheels(document);
}

// Everything hangs on a new root: on the floor, between the wheels, x forward.
void move_root(UrdfDocument& document, const Isometry3d& X_BR, RobotStructure& out) {
  if (X_BR.isApprox(Isometry3d::Identity(), 1e-6)) return;
  UrdfLink base;
  base.name = "base_on_floor";
  for (int i = 2; std::any_of(document.links.begin(), document.links.end(),
                              [&](const UrdfLink& l) { return l.name == base.name; });
       ++i)
    base.name = "base_on_floor_" + std::to_string(i);
  UrdfJoint mount;
  mount.name = base.name + "_mount";
  mount.parent = base.name;
  mount.child = document.root;
  mount.X_PC = X_BR;
  document.links.insert(document.links.begin(), base);
  document.joints.insert(document.joints.begin(), mount);
  std::ostringstream text;
  const Vector3d p = X_BR.translation();
  text << "B: link " << base.name << " is new, on the floor between the wheels, x forward; "
       << document.root << " stands in it at (" << p.x() << ", " << p.y() << ", " << p.z() << ") m";
  out.notes.push_back(text.str());
  document.root = base.name;
}

}  // namespace

void find_base(UrdfDocument& document, const StructureOptions& options, RobotStructure& out) {
  using enum ImportedBase;
  const int root_line = document.link(document.root).line;
  DummyChain chain(document);
  chain.strip();
  std::vector<Wheel> wheels = find_wheels(document);
  if (options.base) {
    out.base = *options.base;
    out.notes.push_back(std::string("base: ") + to_string(out.base) + ", as asked for");
  } else if (chain.planar) {
    out.base = kOmnidirectional;
    out.notes.push_back("base: omnidirectional, since " + chain.note + " let it move freely");
  } else if (wheels.size() == 2) {
    out.base = kDifferentialDrive;
    out.notes.push_back("base: differential_drive, since two wheels turn without limits: " +
                        wheels[0].joint + ", " + wheels[1].joint);
  } else if (wheels.size() == 4) {
    const bool mecanum =
        contains_any(wheels[0].joint + document.name, {"mecanum", "omni", "ridgeback"});
    out.base = kOmnidirectional;
    out.notes.push_back(std::string("base: omnidirectional, since it has four wheels") +
                        (mecanum ? ""
                                 : "; a GUESS: a skid-steered base has four wheels, too, and needs "
                                   "--base differential_drive"));
  } else if (!wheels.empty()) {
    document.fail(wheels[0].line,
                  "joint '" + wheels[0].joint + "' is one of " + std::to_string(wheels.size()) +
                      " wheels, and two or four are understood; say what the base is with --base");
  } else if (chain.floating) {
    document.fail(root_line,
                  "the base floats and has no wheels: legged robots cannot be imported; "
                  "if it stands, say --base fixed");
  } else {
    out.notes.push_back("base: fixed, since nothing turns without limits on the root link");
  }
  if (!chain.note.empty()) out.notes.push_back("left out: " + chain.note + ", and what is above");
  if (out.base == kFixed) return;

  const std::size_t needed = out.base == kOmnidirectional ? 4 : 2;
  if (wheels.empty()) wheels = invent_wheels(document, out.base, out);
  if (wheels.size() == 4 && needed == 2) {  // skid steering: the middle of each side counts
    out.notes.push_back("wheels: of four, " + wheels[0].joint +
                        " and its opposite are driven, and "
                        "the others slide");
    // How much further apart along the axle than across it.
    const auto across = [&](const Wheel& w) {
      const Vector3d d = w.centre - wheels[0].centre;
      const double along = std::abs(d.dot(wheels[0].axis));
      return along - (d - d.dot(wheels[0].axis) * wheels[0].axis).norm();
    };
    const auto opposite =
        std::max_element(wheels.begin() + 1, wheels.end(),
                         [&](const Wheel& a, const Wheel& b) { return across(a) < across(b); });
    for (const Wheel& w : wheels) {
      if (w.joint == wheels[0].joint || w.joint == opposite->joint) continue;
      for (UrdfCollision& c : document.link(document.joint(w.joint)->child).collisions) {
        if (c.name.empty()) c.name = w.joint + "_castor";
        out.castors.push_back(c.name);
      }
    }
    wheels = {wheels[0], *opposite};
  }
  if (wheels.size() != needed) {
    document.fail(root_line, std::string("a base of kind ") + to_string(out.base) + " needs " +
                                 std::to_string(needed) + " wheels, the URDF has " +
                                 std::to_string(wheels.size()));
  }
  for (const Wheel& w : wheels) {
    if (std::abs(w.axis.dot(wheels[0].axis)) < 0.99) {
      document.fail(w.line, "joint '" + w.joint + "': its axis is not parallel to '" +
                                wheels[0].joint +
                                "'s; only mecanum or fixed parallel wheels are "
                                "understood");
    }
    if (w.radius < 1e-3) {
      document.fail(w.line, "joint '" + w.joint +
                                "': its link has no collision shape, so that the "
                                "wheel's radius is unknown; give it a cylinder");
    }
  }
  // y along the axles, to the side where the root's y points; x across.
  Vector3d y = wheels[0].axis;
  y.z() = 0;
  y.normalize();
  if (y.y() < -1e-3 || (std::abs(y.y()) <= 1e-3 && y.x() > 0)) y = -y;
  Vector3d middle = Vector3d::Zero();
  for (const Wheel& w : wheels) middle += w.centre / static_cast<double>(wheels.size());
  Isometry3d X_RB = Isometry3d::Identity();
  X_RB.linear().col(1) = y;
  X_RB.linear().col(0) = y.cross(Vector3d::UnitZ());
  X_RB.translation() = middle;
  X_RB.translation().z() = wheels[0].centre.z() - wheels[0].radius;
  const Isometry3d X_BR = X_RB.inverse();
  move_root(document, X_BR, out);
  for (Wheel& w : wheels) w.centre = X_BR * w.centre;
  std::sort(wheels.begin(), wheels.end(), [](const Wheel& a, const Wheel& b) {
    if (std::abs(a.centre.x() - b.centre.x()) > 0.01) return a.centre.x() > b.centre.x();
    return a.centre.y() > b.centre.y();
  });
  out.wheel_speed_radps = 1e9;
  for (const Wheel& w : wheels) {
    out.wheels.push_back(w.joint);
    if ((X_BR.linear() * w.axis).y() < 0) {
      for (UrdfJoint& j : document.joints) {
        if (j.name == w.joint) j.axis = -j.axis;
      }
      out.notes.push_back("joint " + w.joint +
                          ": its axis is turned round, so that positive speeds "
                          "drive forward; so must its drive");
    }
    const UrdfJoint& j = *document.joint(w.joint);
    out.wheel_speed_radps =
        std::min(out.wheel_speed_radps, j.limit && j.limit->velocity ? *j.limit->velocity : 10.0);
  }
  out.wheel_radius_m = wheels[0].radius;
  out.track_m = wheels[0].centre.y() - wheels[1].centre.y();
  if (needed == 4) out.wheelbase_m = wheels[0].centre.x() - wheels[2].centre.x();
  std::ostringstream text;
  text << "wheels: radius " << out.wheel_radius_m << " m, track " << out.track_m << " m";
  if (needed == 4) text << ", wheelbase " << out.wheelbase_m << " m";
  out.notes.push_back(text.str() + ", from their shapes");

  // What else touches the floor slides on it.
  for (const UrdfLink& link : document.links) {
    const auto path = document.path_to(link.name);
    const bool driven = std::any_of(path.begin(), path.end(), [&](const UrdfJoint* j) {
      return std::find(out.wheels.begin(), out.wheels.end(), j->name) != out.wheels.end();
    });
    if (driven) continue;
    const Isometry3d X = document.poses().at(link.name);
    for (std::size_t i = 0; i < link.collisions.size(); ++i) {
      std::vector<Vector3d> points;
      for (const Vector3d& p : link.collisions[i].solid.surface(0.02)) points.push_back(X * p);
      if (lowest(document, points) > 0.01) continue;
      UrdfCollision& c = document.link(link.name).collisions[i];
      if (c.name.empty()) c.name = link.name + "_" + std::to_string(i);
      if (std::find(out.castors.begin(), out.castors.end(), c.name) == out.castors.end())
        out.castors.push_back(c.name);
    }
  }
  if (!out.castors.empty()) {
    std::string names;
    for (const std::string& c : out.castors) names += (names.empty() ? "" : ", ") + c;
    out.notes.push_back("castors, sliding in the simulation: " + names);
  }
}

}  // namespace wb
