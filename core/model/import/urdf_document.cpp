#include "core/model/import/urdf_document.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iomanip>
#include <sstream>

#include "core/config/config.hpp"

namespace wb {

void UrdfDocument::fail(int line, const std::string& message) const {
  throw config::ConfigError(file.string() + ":" + std::to_string(line) + ": " + message);
}

const UrdfLink& UrdfDocument::link(const std::string& name) const {
  for (const UrdfLink& l : links) {
    if (l.name == name) return l;
  }
  throw config::ConfigError(file.string() + ": has no link '" + name + "'");
}
UrdfLink& UrdfDocument::link(const std::string& name) {
  return const_cast<UrdfLink&>(std::as_const(*this).link(name));
}

const UrdfJoint* UrdfDocument::joint(const std::string& name) const {
  for (const UrdfJoint& j : joints) {
    if (j.name == name) return &j;
  }
  return nullptr;
}

const UrdfJoint* UrdfDocument::joint_above(const std::string& link) const {
  for (const UrdfJoint& j : joints) {
    if (j.child == link) return &j;
  }
  return nullptr;
}

std::vector<const UrdfJoint*> UrdfDocument::joints_below(const std::string& link) const {
  std::vector<const UrdfJoint*> out;
  for (const UrdfJoint& j : joints) {
    if (j.parent == link) out.push_back(&j);
  }
  return out;
}

std::vector<const UrdfJoint*> UrdfDocument::path_to(const std::string& link) const {
  std::vector<const UrdfJoint*> out;
  for (const UrdfJoint* j = joint_above(link); j != nullptr; j = joint_above(j->parent)) {
    out.insert(out.begin(), j);
  }
  return out;
}

bool UrdfDocument::is_below(const std::string& link, const std::string& ancestor) const {
  if (link == ancestor) return true;
  const UrdfJoint* up = joint_above(link);
  return up != nullptr && is_below(up->parent, ancestor);
}

std::map<std::string, Eigen::Isometry3d> UrdfDocument::poses() const {
  std::map<std::string, Eigen::Isometry3d> out;
  out[root] = Eigen::Isometry3d::Identity();
  for (const UrdfJoint& j : joints) out[j.child] = out.at(j.parent) * j.X_PC;
  return out;
}

namespace {

std::string number(double value) {
  std::ostringstream out;
  out << std::setprecision(12) << (std::abs(value) < 1e-15 ? 0.0 : value);
  return out.str();
}
std::string triple(const Eigen::Vector3d& v) {
  return number(v.x()) + " " + number(v.y()) + " " + number(v.z());
}

std::string origin(const Eigen::Isometry3d& X) {
  const Eigen::Matrix3d R = X.linear();  // = Rz(yaw) Ry(pitch) Rx(roll)
  const double pitch = std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0)));
  double roll = std::atan2(R(2, 1), R(2, 2)), yaw = std::atan2(R(1, 0), R(0, 0));
  if (std::hypot(R(0, 0), R(1, 0)) < 1e-9) {  // straight up or down: yaw and roll turn alike
    yaw = 0;
    roll = std::atan2(-R(1, 2), R(1, 1));
  }
  return "<origin xyz=\"" + triple(X.translation()) + "\" rpy=\"" +
         triple(Eigen::Vector3d(roll, pitch, yaw)) + "\"/>";
}

std::string geometry(const Solid& s) {
  const Eigen::Vector3d& h = s.half;
  switch (s.kind) {
    case Solid::Kind::kBox:
      return "<box size=\"" + triple(2 * h) + "\"/>";
    case Solid::Kind::kCylinder:
      return "<cylinder radius=\"" + number(h.x()) + "\" length=\"" + number(2 * h.z()) + "\"/>";
    case Solid::Kind::kSphere:
      return "<sphere radius=\"" + number(h.x()) + "\"/>";
    case Solid::Kind::kMesh:
      break;
  }
  throw config::ConfigError(
      "a mesh stays in the URDF that is written");  // never: import replaces it
}

void write_link(std::ostream& out, const UrdfLink& link) {
  out << "  <link name=\"" << link.name << "\"";
  if (!link.inertial && link.collisions.empty()) {
    out << "/>\n";
    return;
  }
  out << ">\n";
  if (link.inertial) {
    const UrdfInertial& in = *link.inertial;
    out << "    <inertial>\n      " << origin(in.X_LI) << "\n      <mass value=\""
        << number(in.mass) << "\"/>\n      <inertia";
    const char* names[] = {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"};
    int k = 0;
    for (int r = 0; r < 3; ++r) {
      for (int c = r; c < 3; ++c) {
        out << " " << names[k++] << "=\"" << number(in.inertia(r, c)) << "\"";
      }
    }
    out << "/>\n    </inertial>\n";
  }
  for (const UrdfCollision& c : link.collisions) {
    out << "    <collision name=\"" << c.name << "\">\n      " << origin(c.solid.X_LS)
        << "\n      <geometry>" << geometry(c.solid) << "</geometry>\n    </collision>\n";
  }
  out << "  </link>\n";
}

void write_joint(std::ostream& out, const UrdfJoint& j) {
  constexpr const char* kTypes[] = {"fixed",     "revolute", "continuous",
                                    "prismatic", "planar",   "floating"};
  out << "  <joint name=\"" << j.name << "\" type=\"" << kTypes[static_cast<int>(j.type)]
      << "\">\n    <parent link=\"" << j.parent << "\"/>\n    <child link=\"" << j.child
      << "\"/>\n    " << origin(j.X_PC) << "\n";
  if (j.movable()) {
    out << "    <axis xyz=\"" << triple(j.axis) << "\"/>\n    <limit lower=\""
        << number(j.limit->lower) << "\" upper=\"" << number(j.limit->upper) << "\" effort=\""
        << number(j.limit->effort.value()) << "\" velocity=\"" << number(j.limit->velocity.value())
        << "\"/>\n    <dynamics damping=\"" << number(j.damping) << "\" friction=\""
        << number(j.friction) << "\"/>\n";
    if (j.mimic) {
      out << "    <mimic joint=\"" << j.mimic->joint << "\" multiplier=\""
          << number(j.mimic->multiplier) << "\" offset=\"" << number(j.mimic->offset) << "\"/>\n";
    }
  }
  out << "  </joint>\n";
}

}  // namespace

void UrdfDocument::write(const std::filesystem::path& to, const std::string& comment) const {
  std::ofstream out(to);
  out << "<?xml version=\"1.0\"?>\n<!-- " << comment << " -->\n<robot name=\"" << name << "\">\n";
  write_link(out, link(root));
  for (const UrdfJoint& j : joints) {
    write_link(out, link(j.child));
    write_joint(out, j);
  }
  out << "</robot>\n";
  if (!out.flush()) throw config::ConfigError(to.string() + ": cannot be written");
}

}  // namespace wb
