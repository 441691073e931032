// UrdfDocument::read and everything it refuses.
#include <tinyxml2.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include "core/config/config.hpp"
#include "core/model/import/urdf_document.hpp"

namespace wb {
namespace {

using tinyxml2::XMLElement;
namespace fs = std::filesystem;

class Reader {
 public:
  Reader(UrdfDocument& document, std::vector<fs::path> packages)
      : out_(document), packages_(std::move(packages)) {}

  void read() {
    tinyxml2::XMLDocument xml;
    if (xml.LoadFile(out_.file.c_str()) != tinyxml2::XML_SUCCESS) {
      if (!fs::exists(out_.file)) {
        throw config::ConfigError(out_.file.string() + ": cannot be opened");
      }
      out_.fail(xml.ErrorLineNum(), std::string("is no well-formed XML: ") + xml.ErrorStr());
    }
    const XMLElement* robot = xml.FirstChildElement("robot");
    if (robot == nullptr) out_.fail(1, "has no <robot> element, so it is no URDF");
    refuse_xacro(*robot);
    out_.name = attribute(*robot, "name");
    for (const XMLElement* e = robot->FirstChildElement("link"); e;
         e = e->NextSiblingElement("link"))
      read_link(*e);
    for (const XMLElement* e = robot->FirstChildElement("joint"); e;
         e = e->NextSiblingElement("joint"))
      read_joint(*e);
    if (out_.links.empty()) out_.fail(robot->GetLineNum(), "has no <link>");
    check_tree();
    check_mimics();
  }

 private:
  void refuse_xacro(const XMLElement& robot) const {
    for (const XMLElement* e = robot.FirstChildElement(); e; e = e->NextSiblingElement()) {
      if (std::string(e->Name()).starts_with("xacro:")) {
        out_.fail(e->GetLineNum(), "<" + std::string(e->Name()) +
                                       ">: this is xacro source; run `xacro FILE > robot.urdf` and "
                                       "import that");
      }
    }
  }

  std::string attribute(const XMLElement& e, const char* key) const {
    const char* value = e.Attribute(key);
    if (value == nullptr || *value == '\0') {
      out_.fail(e.GetLineNum(),
                "<" + std::string(e.Name()) + "> lacks its attribute '" + std::string(key) + "'");
    }
    return value;
  }

  std::vector<double> numbers(const XMLElement& e, const char* key, std::size_t count) const {
    std::istringstream in(attribute(e, key));
    std::vector<double> values;
    for (std::string word; in >> word;) {
      char* end = nullptr;
      const double value = std::strtod(word.c_str(), &end);
      if (*end != '\0' || !std::isfinite(value)) {
        out_.fail(e.GetLineNum(), where_ + ": '" + key + "' holds '" + word +
                                      "', which is no finite number; correct it");
      }
      values.push_back(value);
    }
    if (values.size() != count) {
      out_.fail(e.GetLineNum(), where_ + ": '" + std::string(key) + "' holds " +
                                    std::to_string(values.size()) + " numbers, must hold " +
                                    std::to_string(count));
    }
    return values;
  }
  double number(const XMLElement& e, const char* key) const { return numbers(e, key, 1)[0]; }
  double number_or(const XMLElement& e, const char* key, double otherwise) const {
    return e.Attribute(key) ? number(e, key) : otherwise;
  }
  Eigen::Vector3d vector3(const XMLElement& e, const char* key) const {
    const std::vector<double> v = numbers(e, key, 3);
    return {v[0], v[1], v[2]};
  }
  double positive(const XMLElement& e, const char* key) const {
    const double value = number(e, key);
    if (value <= 0) {
      out_.fail(e.GetLineNum(),
                where_ + ": '" + key + "' is " + std::to_string(value) + ", must be positive");
    }
    return value;
  }

  Eigen::Isometry3d origin(const XMLElement& parent) const {
    Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
    const XMLElement* e = parent.FirstChildElement("origin");
    if (e == nullptr) return X;
    if (e->Attribute("xyz")) X.translation() = vector3(*e, "xyz");
    if (e->Attribute("rpy")) {
      const Eigen::Vector3d rpy = vector3(*e, "rpy");
      X.linear() = (Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) *
                    Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
                    Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()))
                       .toRotationMatrix();
    }
    return X;
  }

  void read_link(const XMLElement& e) {
    UrdfLink link;
    link.line = e.GetLineNum();
    where_ = "link";
    link.name = attribute(e, "name");
    where_ = "link '" + link.name + "'";
    for (const UrdfLink& other : out_.links) {
      if (other.name == link.name)
        out_.fail(link.line, where_ + " stands twice, first in line " + std::to_string(other.line));
    }
    if (const XMLElement* inertial = e.FirstChildElement("inertial")) {
      link.inertial = read_inertial(*inertial);
    }
    for (const XMLElement* c = e.FirstChildElement("collision"); c;
         c = c->NextSiblingElement("collision"))
      link.collisions.push_back(read_collision(*c));
    out_.links.push_back(std::move(link));
  }

  std::optional<UrdfInertial> read_inertial(const XMLElement& e) {
    UrdfInertial in;
    in.X_LI = origin(e);
    const XMLElement* mass = e.FirstChildElement("mass");
    const XMLElement* inertia = e.FirstChildElement("inertia");
    if (mass == nullptr || inertia == nullptr) {
      out_.fail(e.GetLineNum(), where_ +
                                    ": <inertial> needs <mass> and <inertia>; add them, or "
                                    "leave <inertial> out and it is guessed from the shapes");
    }
    in.mass = number(*mass, "value");
    const double xx = number(*inertia, "ixx"), yy = number(*inertia, "iyy"),
                 zz = number(*inertia, "izz"), xy = number_or(*inertia, "ixy", 0),
                 xz = number_or(*inertia, "ixz", 0), yz = number_or(*inertia, "iyz", 0);
    in.inertia << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    // Exporters write links without mass as zeros.
    if (in.mass == 0 && in.inertia.isZero()) {
      out_.notes.push_back("line " + std::to_string(e.GetLineNum()) + ": " + where_ +
                           " has a mass of zero: taken as a link without inertia");
      return std::nullopt;
    }
    if (in.mass <= 0) {
      out_.fail(mass->GetLineNum(),
                where_ + ": its mass is " + std::to_string(in.mass) +
                    " kg, must be positive; correct it or leave <inertial> out");
    }
    const Eigen::Vector3d moments =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(in.inertia).eigenvalues();
    if (moments[0] <= 0) {
      out_.fail(inertia->GetLineNum(),
                where_ + ": its inertia is not positive: smallest principal moment " +
                    std::to_string(moments[0]) + " kg m^2; correct it or leave <inertial> out");
    }
    // CAD exports round to a few digits.
    if (moments[0] + moments[1] < 0.99 * moments[2]) {
      std::ostringstream text;
      text << where_ << ": no body has the principal moments " << moments.transpose()
           << " kg m^2, since the largest exceeds the sum of the others; correct it or leave "
              "<inertial> out";
      out_.fail(inertia->GetLineNum(), text.str());
    }
    return in;
  }

  UrdfCollision read_collision(const XMLElement& e) {
    UrdfCollision c;
    if (e.Attribute("name")) c.name = e.Attribute("name");
    c.solid.X_LS = origin(e);
    const XMLElement* geometry = e.FirstChildElement("geometry");
    const XMLElement* shape = geometry ? geometry->FirstChildElement() : nullptr;
    if (shape == nullptr) out_.fail(e.GetLineNum(), where_ + ": <collision> without a shape");
    const std::string kind = shape->Name();
    if (kind == "box") {
      c.solid.half = 0.5 * vector3(*shape, "size");
      if (c.solid.half.minCoeff() <= 0) {
        out_.fail(shape->GetLineNum(), where_ + ": a box's size must be positive");
      }
    } else if (kind == "cylinder") {
      c.solid.kind = Solid::Kind::kCylinder;
      const double r = positive(*shape, "radius");
      c.solid.half = {r, r, 0.5 * positive(*shape, "length")};
    } else if (kind == "sphere") {
      c.solid.kind = Solid::Kind::kSphere;
      c.solid.half.setConstant(positive(*shape, "radius"));
    } else if (kind == "mesh") {
      c.solid.kind = Solid::Kind::kMesh;
      const Eigen::Vector3d scale =
          shape->Attribute("scale") ? vector3(*shape, "scale") : Eigen::Vector3d::Ones();
      const fs::path file = resolve(*shape, attribute(*shape, "filename"));
      c.mesh = file.string();
      try {
        c.solid.mesh = TriangleMesh::read(file, scale);
      } catch (const config::ConfigError& error) {
        out_.fail(shape->GetLineNum(), where_ + ": " + error.what());
      }
    } else {
      out_.fail(shape->GetLineNum(),
                where_ + ": shape <" + kind + "> is unknown, allowed: box, cylinder, sphere, mesh");
    }
    return c;
  }

  // package://NAME/REST: REST under a folder NAME beside or above the URDF, or under --package DIR,
  // whether DIR is the package itself or holds it.
  fs::path resolve(const XMLElement& e, const std::string& uri) const {
    const fs::path folder = fs::absolute(out_.file).parent_path();
    std::vector<fs::path> tries;
    if (uri.starts_with("package://") || uri.starts_with("model://")) {
      const fs::path path = uri.substr(uri.find("://") + 3);
      fs::path rest;
      for (auto part = std::next(path.begin()); part != path.end(); ++part) rest /= *part;
      for (const fs::path& p : packages_) tries.insert(tries.end(), {p / path, p / rest});
      for (fs::path up = folder; up != up.root_path(); up = up.parent_path()) {
        tries.push_back(up / path);
        if (up.filename() == *path.begin()) tries.push_back(up / rest);
      }
      tries.push_back(folder / rest);
    } else if (uri.starts_with("file://")) {
      tries.push_back(uri.substr(7));
    } else {
      tries.push_back(folder / uri);
    }
    for (const fs::path& t : tries) {
      if (fs::is_regular_file(t)) return t;
    }
    out_.fail(e.GetLineNum(), where_ + ": the mesh '" + uri +
                                  "' is not found; name the folder that holds its package with "
                                  "--package DIR");
  }

  void read_joint(const XMLElement& e) {
    UrdfJoint j;
    j.line = e.GetLineNum();
    where_ = "joint";
    j.name = attribute(e, "name");
    where_ = "joint '" + j.name + "'";
    if (const UrdfJoint* other = out_.joint(j.name)) {
      out_.fail(j.line, where_ + " stands twice, first in line " + std::to_string(other->line));
    }
    const std::string type = attribute(e, "type");
    constexpr const char* kTypes[] = {"fixed",     "revolute", "continuous",
                                      "prismatic", "planar",   "floating"};
    const auto at = std::find(std::begin(kTypes), std::end(kTypes), type);
    if (at == std::end(kTypes)) {
      out_.fail(j.line,
                where_ + ": type '" + type +
                    "' is unknown, allowed: fixed, revolute, continuous, prismatic, planar, "
                    "floating");
    }
    j.type = static_cast<UrdfJoint::Type>(at - std::begin(kTypes));
    j.parent = end_of(e, "parent");
    j.child = end_of(e, "child");
    j.X_PC = origin(e);
    if (const XMLElement* axis = e.FirstChildElement("axis")) {
      j.axis = vector3(*axis, "xyz");
      if (j.movable() && j.type != UrdfJoint::Type::kFloating && j.axis.norm() < 1e-6) {
        out_.fail(axis->GetLineNum(), where_ + ": its axis is zero; give it a direction");
      }
      j.axis.normalize();
    }
    if (const XMLElement* limit = e.FirstChildElement("limit")) j.limit = read_limit(*limit, j);
    if (!j.limit &&
        (j.type == UrdfJoint::Type::kRevolute || j.type == UrdfJoint::Type::kPrismatic)) {
      out_.fail(j.line, where_ + " has no <limit>; add lower and upper" +
                            (j.turns() ? ", or make it continuous" : ""));
    }
    if (const XMLElement* dynamics = e.FirstChildElement("dynamics")) {
      j.damping = std::max(0.0, number_or(*dynamics, "damping", 0));
      j.friction = std::max(0.0, number_or(*dynamics, "friction", 0));
    }
    if (const XMLElement* mimic = e.FirstChildElement("mimic")) {
      j.mimic = UrdfMimic{attribute(*mimic, "joint"), number_or(*mimic, "multiplier", 1),
                          number_or(*mimic, "offset", 0)};
    }
    out_.joints.push_back(std::move(j));
  }

  std::string end_of(const XMLElement& joint, const char* which) const {
    const XMLElement* e = joint.FirstChildElement(which);
    if (e == nullptr) out_.fail(joint.GetLineNum(), where_ + " has no <" + which + ">");
    const std::string name = attribute(*e, "link");
    for (const UrdfLink& link : out_.links) {
      if (link.name == name) return name;
    }
    out_.fail(e->GetLineNum(),
              where_ + ": its " + which + " '" + name + "' is no link of this file");
  }

  UrdfLimit read_limit(const XMLElement& e, const UrdfJoint& j) const {
    UrdfLimit limit;
    limit.lower = number_or(e, "lower", 0);
    limit.upper = number_or(e, "upper", 0);
    for (const char* key : {"velocity", "effort"}) {
      const double value = number_or(e, key, 0);
      if (value < 0) {
        out_.fail(e.GetLineNum(), where_ + ": its limit of " + key +
                                      " is negative: " + std::to_string(value) + "; correct it");
      }
      if (value > 0) (key[0] == 'v' ? limit.velocity : limit.effort) = value;
    }
    const bool bounded =
        j.type == UrdfJoint::Type::kRevolute || j.type == UrdfJoint::Type::kPrismatic;
    if (bounded && limit.lower >= limit.upper) {
      out_.fail(e.GetLineNum(), where_ + ": its limits leave no room: lower " +
                                    std::to_string(limit.lower) + ", upper " +
                                    std::to_string(limit.upper) +
                                    "; correct them, or make the joint fixed");
    }
    return limit;
  }

  // One tree: each link has one parent, one link has none; then joints are sorted from the root.
  void check_tree() {
    std::map<std::string, const UrdfJoint*> above;
    for (const UrdfJoint& j : out_.joints) {
      const auto [other, first] = above.insert({j.child, &j});
      if (!first) {
        out_.fail(j.line, "joint '" + j.name + "': link '" + j.child + "' hangs on '" +
                              other->second->name + "' (line " +
                              std::to_string(other->second->line) +
                              ") already. A loop cannot be controlled: cut it, and let a <mimic> "
                              "stand for it");
      }
    }
    for (const UrdfLink& link : out_.links) {
      if (above.contains(link.name)) continue;
      if (!out_.root.empty()) {
        out_.fail(link.line, "link '" + link.name + "' hangs on no joint, and neither does '" +
                                 out_.root + "' (line " +
                                 std::to_string(out_.link(out_.root).line) +
                                 "); join them, or remove one");
      }
      out_.root = link.name;
    }
    std::vector<UrdfJoint> sorted;
    std::set<std::string> reached;
    if (!out_.root.empty()) {
      const auto descend = [&](const auto& self, const std::string& link) -> void {
        for (const UrdfJoint& j : out_.joints) {
          if (j.parent != link) continue;
          sorted.push_back(j);
          reached.insert(j.name);
          self(self, j.child);
        }
      };
      descend(descend, out_.root);
    }
    for (const UrdfJoint& j : out_.joints) {
      if (!reached.contains(j.name)) {
        out_.fail(j.line, "joint '" + j.name +
                              "' belongs to a loop of links; cut it, and let a "
                              "<mimic> stand for it");
      }
    }
    out_.joints = std::move(sorted);
  }

  void check_mimics() const {
    for (const UrdfJoint& j : out_.joints) {
      if (!j.mimic) continue;
      const UrdfJoint* leader = out_.joint(j.mimic->joint);
      const std::string at = "joint '" + j.name + "' mimics '" + j.mimic->joint + "', ";
      if (leader == nullptr) out_.fail(j.line, at + "which is no joint of this file");
      if (leader == &j) out_.fail(j.line, at + "itself; remove the <mimic>");
      if (leader->mimic) {
        out_.fail(j.line, at + "which mimics '" + leader->mimic->joint + "' itself; name that one");
      }
      if (!leader->movable()) out_.fail(j.line, at + "which is fixed");
    }
  }

  UrdfDocument& out_;
  std::vector<fs::path> packages_;
  std::string where_;  // what is being read, for errors
};

}  // namespace

UrdfDocument UrdfDocument::read(const fs::path& file, const std::vector<fs::path>& packages) {
  UrdfDocument out;
  out.file = file;
  Reader(out, packages).read();
  return out;
}

}  // namespace wb
