#include "core/model/import/robot_structure.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <numbers>
#include <set>
#include <sstream>
#include <stdexcept>

#include "core/types/limits.hpp"

namespace wb {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
constexpr double kGravity = 9.81;
constexpr double kDensity_kgpm3 = 1000;  // a housing with motors in it

std::string lower_case(std::string s) {
  std::transform(s.begin(), s.end(), s.begin(), [](unsigned char c) { return std::tolower(c); });
  return s;
}

// Cameras: links so named, the optical frames if there are any; one is invented if there is none.
void find_cameras(UrdfDocument& document, RobotStructure& out) {
  std::vector<std::string> named, optical;
  for (const UrdfLink& link : document.links) {
    if (!contains_any(link.name, {"camera"})) continue;
    named.push_back(link.name);
    if (contains_any(link.name, {"depth_optical"})) optical.push_back(link.name);
  }
  if (optical.empty()) {
    for (const std::string& name : named) {
      if (contains_any(name, {"optical"})) optical.push_back(name);
    }
  }
  out.cameras = optical.empty() ? named : optical;
  if (out.cameras.size() > kMaxCameras) {
    std::ostringstream text;
    text << "cameras: only the first " << kMaxCameras << " of " << out.cameras.size()
         << " are used";
    out.notes.push_back(text.str());
    out.cameras.resize(kMaxCameras);
  }
  if (!out.cameras.empty()) {
    if (optical.empty()) {
      out.notes.push_back(
          "cameras: links named so are taken as optical frames (z forward, x right)");
    }
    return;
  }
  // Looks forward and 15 degrees down from above the arm's first joint.
  const UrdfJoint& first = *document.joint(out.joints.front());
  Isometry3d X_RC = Isometry3d::Identity();
  X_RC.translation() = document.poses().at(first.child).translation() + Vector3d(0, 0, 0.4);
  const double down = 15 * std::numbers::pi / 180;
  X_RC.linear().col(2) = Vector3d(std::cos(down), 0, -std::sin(down));
  X_RC.linear().col(0) = -Vector3d::UnitY();
  X_RC.linear().col(1) = X_RC.linear().col(2).cross(X_RC.linear().col(0));
  out.cameras = {add_frame(document, "camera_front", document.root, X_RC)};
  out.notes.push_back(
      "cameras: the URDF has none, " + out.cameras[0] +
      " is invented 0.4 m above the arm's first joint, 15 degrees down; put it where "
      "yours is");
}

void find_sensors(UrdfDocument& document, RobotStructure& out) {
  for (const UrdfLink& link : document.links) {
    bool base = true;  // rigid with it
    for (const UrdfJoint* j : document.path_to(link.name)) base &= !j->movable();
    if (base && contains_any(link.name, {"imu"}) && out.imu.empty()) out.imu = link.name;
  }
  if (out.imu.empty()) {
    out.imu = add_frame(document, "imu_link", document.root, Isometry3d::Identity());
    out.notes.push_back("IMU: the URDF names none, imu_link at the base's origin is invented");
  }
  // The wrist sensor carries the first link with mass beyond the last joint's own.
  const std::vector<const UrdfJoint*> path = document.path_to(out.end_effector);
  out.wrench_link = document.joint(out.joints.back())->child;
  bool beyond = false;
  for (const UrdfJoint* j : path) {
    if (beyond && document.link(j->child).inertial) {
      out.wrench_link = j->child;
      break;
    }
    beyond |= j->name == out.joints.back();
  }
  out.notes.push_back("wrist wrench: sensed between link " + out.wrench_link +
                      " and what carries it");
}

// Everything that is to stay movable; the rest is fixed at zero or the nearest limit.
void lock_the_rest(UrdfDocument& document, RobotStructure& out) {
  std::set<std::string> moved(out.joints.begin(), out.joints.end());
  moved.insert(out.wheels.begin(), out.wheels.end());
  moved.insert(out.fingers.begin(), out.fingers.end());
  std::map<std::string, double> at;
  for (const UrdfJoint& j : document.joints) {
    at[j.name] = j.limit && j.type != UrdfJoint::Type::kContinuous
                     ? std::clamp(0.0, j.limit->lower, j.limit->upper)
                     : 0.0;
  }
  std::string locked;
  std::vector<std::string> names;
  for (const UrdfJoint& j : document.joints) {
    if (j.movable() && !moved.contains(j.name)) names.push_back(j.name);
  }
  for (const std::string& name : names) {
    const UrdfJoint& j = *document.joint(name);
    if (j.type == UrdfJoint::Type::kPlanar || j.type == UrdfJoint::Type::kFloating) {
      document.fail(j.line, "joint '" + name + "' is " +
                                (j.type == UrdfJoint::Type::kPlanar ? "planar" : "floating") +
                                " inside the robot; only the base may move so, above every link "
                                "with shapes. Make it fixed, or split it into simple joints");
    }
    double value = at[name];
    if (j.mimic) {
      const double leader = moved.contains(j.mimic->joint) ? 0 : at[j.mimic->joint];
      value = j.mimic->multiplier * leader + j.mimic->offset;
    }
    lock_joint(document, name, value);
    if (!locked.empty()) locked += ", ";
    locked += name;
  }
  if (!names.empty()) {
    out.notes.push_back("fixed at zero, or at the limit nearest to it: " + locked);
  }
}

// Total weight beyond a joint times how far it can be: no posture loads the joint more.
double largest_load(const UrdfDocument& document, const UrdfJoint& joint) {
  double load = 0;
  for (const UrdfLink& link : document.links) {
    if (!link.inertial || !document.is_below(link.name, joint.child)) continue;
    double away = link.inertial->X_LI.translation().norm();
    for (const UrdfJoint* j = document.joint_above(link.name); j->name != joint.name;
         j = document.joint_above(j->parent))
      away += j->X_PC.translation().norm();
    load += link.inertial->mass * kGravity * (joint.turns() ? away : 1);
  }
  return load;
}

UrdfInertial guessed_inertia(const UrdfLink& link) {
  UrdfInertial out;
  double volume = 0;
  std::vector<Vector3d> corners;
  for (const UrdfCollision& c : link.collisions) {
    volume += c.solid.volume();
    const TriangleMesh hull = c.solid.enclosing(1e9);
    corners.insert(corners.end(), hull.vertices.begin(), hull.vertices.end());
  }
  Vector3d size = Vector3d::Constant(0.04);
  if (!corners.empty()) {
    const auto [low, high] = bounds(corners);
    out.X_LI.translation() = 0.5 * (low + high);
    size = (high - low).cwiseMax(0.02);
  }
  out.mass = std::max(0.1, kDensity_kgpm3 * volume);
  const Vector3d s = size.cwiseProduct(size);
  out.inertia.diagonal() = out.mass / 12 * Vector3d(s.y() + s.z(), s.x() + s.z(), s.x() + s.y());
  return out;
}

}  // namespace

const char* to_string(ImportedBase base) {
  constexpr const char* kNames[] = {"fixed", "differential_drive", "omnidirectional"};
  return kNames[static_cast<int>(base)];
}

ImportedBase imported_base(const std::string& name) {
  for (const ImportedBase base :
       {ImportedBase::kFixed, ImportedBase::kDifferentialDrive, ImportedBase::kOmnidirectional}) {
    if (name == to_string(base)) return base;
  }
  throw std::out_of_range("base kind '" + name +
                          "' is unknown, allowed: fixed, differential_drive, omnidirectional");
}

bool contains_any(const std::string& name, const std::vector<std::string>& words) {
  const std::string text = lower_case(name);
  return std::any_of(words.begin(), words.end(),
                     [&](const std::string& w) { return text.find(w) != std::string::npos; });
}

std::string add_frame(UrdfDocument& document, const std::string& name, const std::string& parent,
                      const Isometry3d& X_PC) {
  const auto taken = [&](const std::string& n) {
    return std::any_of(document.links.begin(), document.links.end(),
                       [&](const UrdfLink& l) { return l.name == n; });
  };
  std::string free = name;
  for (int i = 2; taken(free) || document.joint(free + "_mount"); ++i) {
    free = name;
    free.append("_").append(std::to_string(i));
  }
  UrdfLink link;
  link.name = free;
  document.links.push_back(link);
  UrdfJoint joint;
  joint.name = free + "_mount";
  joint.parent = parent;
  joint.child = free;
  joint.X_PC = X_PC;
  document.joints.push_back(joint);
  return free;
}

void lock_joint(UrdfDocument& document, const std::string& name, double value) {
  for (UrdfJoint& j : document.joints) {
    if (j.name != name) continue;
    if (j.turns()) {
      j.X_PC.rotate(Eigen::AngleAxisd(value, j.axis));
    } else {
      j.X_PC.translate(value * j.axis);
    }
    j.type = UrdfJoint::Type::kFixed;
    j.mimic.reset();
  }
}

void fill_gaps(UrdfDocument& document, RobotStructure& out) {
  std::set<std::string> names;
  for (UrdfLink& link : document.links) {
    for (std::size_t i = 0; i < link.collisions.size(); ++i) {
      std::string& name = link.collisions[i].name;
      if (name.empty()) name.append(link.name).append("_").append(std::to_string(i));
      while (!names.insert(name).second) name.append("_").append(std::to_string(i));
    }
  }
  // A body is a link with everything rigid below it; one with mass is enough.
  for (const UrdfJoint& j : document.joints) {
    if (!j.movable()) continue;
    UrdfLink* shaped = nullptr;
    bool heavy = false;
    for (UrdfLink& link : document.links) {
      const UrdfJoint* up = document.joint_above(link.name);
      while (up != nullptr && !up->movable()) up = document.joint_above(up->parent);
      if (up == nullptr || up->name != j.name) continue;
      heavy |= link.inertial.has_value();
      if (!link.collisions.empty() && shaped == nullptr) shaped = &link;
    }
    if (heavy) continue;
    UrdfLink& link = shaped ? *shaped : document.link(j.child);
    link.inertial = guessed_inertia(link);
    std::ostringstream text;
    text << "inertia of link " << link.name << ": the URDF has none, taken as "
         << link.inertial->mass << " kg (" << kDensity_kgpm3
         << " kg/m3 in its shapes, at least 0.1 kg) of its box";
    out.notes.push_back(text.str());
  }
  bool heavy = false;
  for (const UrdfLink& link : document.links) {
    const UrdfJoint* up = document.joint_above(link.name);
    while (up != nullptr && !up->movable()) up = document.joint_above(up->parent);
    heavy |= up == nullptr && link.inertial;
  }
  if (!heavy && out.base != ImportedBase::kFixed) {
    std::string with_shape = document.root;
    for (const UrdfLink& link : document.links) {
      bool rigid = true;
      for (const UrdfJoint* j : document.path_to(link.name)) rigid &= !j->movable();
      if (rigid && !link.collisions.empty() && document.link(with_shape).collisions.empty())
        with_shape = link.name;
    }
    UrdfLink& link = document.link(with_shape);
    link.inertial = guessed_inertia(link);
    std::ostringstream text;
    text << "inertia of the base: the URDF has none, taken as " << link.inertial->mass
         << " kg of link " << with_shape << "'s box";
    out.notes.push_back(text.str());
  }
  for (UrdfJoint& j : document.joints) {
    if (!j.movable()) continue;
    if (!j.limit) j.limit.emplace();
    const bool wheel = std::find(out.wheels.begin(), out.wheels.end(), j.name) != out.wheels.end();
    std::ostringstream text;
    const bool no_velocity = !j.limit->velocity, no_effort = !j.limit->effort;
    if (no_velocity) {
      j.limit->velocity = wheel ? 10.0 : j.turns() ? 1.0 : 0.1;
      text << " velocity " << *j.limit->velocity << (j.turns() ? " rad/s" : " m/s");
    }
    if (no_effort) {
      // Twice what gravity can ask of it.
      const double load = 2 * largest_load(document, j);
      j.limit->effort = wheel ? 50.0 : std::max(j.turns() ? 5.0 : 20.0, std::ceil(load));
      text << (no_velocity ? "," : "") << " effort " << *j.limit->effort
           << (j.turns() ? " Nm" : " N") << (wheel ? "" : " (twice the largest possible load)");
    }
    if (no_velocity || no_effort) {
      out.notes.push_back("limits of joint " + j.name + ": the URDF lacks some, taken as" +
                          text.str());
    }
  }
}

RobotStructure find_structure(UrdfDocument& document, const StructureOptions& options) {
  RobotStructure out;
  out.notes = document.notes;
  find_base(document, options, out);
  find_arm(document, options, out);
  lock_the_rest(document, out);
  find_cameras(document, out);
  find_sensors(document, out);
  fill_gaps(document, out);
  return out;
}

}  // namespace wb
