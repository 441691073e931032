#include "drivers/sim/mjcf.hpp"

#include <algorithm>
#include <cstring>
#include <iomanip>
#include <sstream>

#include "core/model/urdf_file.hpp"

namespace wb::sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

// Contacts a handle or a pad makes: stiff, with the friction that a grasp needs (the sweep in
// facts/simulation.md, section 1).
constexpr const char* kGrip = R"( condim="4" solref="0.005 1" solimp="0.95 0.99 0.001")";
constexpr const char* kHeader = R"(<mujoco model="wholebody">
<compiler angle="radian" autolimits="true" inertiafromgeom="false"/>
<size njmax="800" nconmax="200"/>
<default><geom condim="3" friction="0.8 0.005 0.0001" solref="0.005 1"/></default>
)";

class Writer {
 public:
  explicit Writer(const PluginConfig& config)
      : config_(config), urdf_(read_urdf(config.robot.urdf)) {
    out_ << std::setprecision(17);
  }

  std::string write() {
    out_
        << kHeader
        << R"(<option cone="elliptic" impratio="10" noslip_iterations="3" solver="Newton" iterations="50" timestep=")"
        << 1e-9 * static_cast<double>(config_.sim.step_ns)
        << "\"><flag sensor=\"disable\"/></option>\n<worldbody>\n";
    out_
        << R"(<geom name="floor" type="plane" size="5 5 0.1" friction="0.9 0.005 0.0001" contype=")"
        << bits::kFloor << "\" conaffinity=\"0\"" << rgba(config_.scene.colours.at("floor"))
        << "/>\n";
    for (const Unit& unit : config_.scene.units) write_unit(unit);
    write_link(*urdf_->getRoot());
    out_ << "</worldbody>\n<actuator>\n" << actuators_.str() << "</actuator>\n";
    write_equality();
    write_excludes();
    out_ << "</mujoco>\n";
    return out_.str();
  }

 private:
  static std::string text(const Vector3d& v) {
    std::ostringstream s;
    s << std::setprecision(17) << v.x() << ' ' << v.y() << ' ' << v.z();
    return s.str();
  }
  static std::string triple(const std::array<double, 3>& v) { return text({v[0], v[1], v[2]}); }
  static std::string rgba(const std::array<double, 3>& c) {
    return " rgba=\"" + triple(c) + " 1\"";
  }
  static std::string pose(const Isometry3d& X) {
    const Quaterniond q(X.linear());
    std::ostringstream s;
    s << std::setprecision(17) << " pos=\"" << text(X.translation()) << "\" quat=\"" << q.w() << ' '
      << q.x() << ' ' << q.y() << ' ' << q.z() << '"';
    return s.str();
  }

  void write_solid(const Solid& solid) {
    const char* type = solid.kind == Solid::Kind::kBox       ? "box"
                       : solid.kind == Solid::Kind::kCapsule ? "capsule"
                                                             : "cylinder";
    out_ << "<geom name=\"" << solid.name << "\" type=\"" << type << "\" size=\""
         << text(solid.half) << '"' << pose(solid.X_body)
         << rgba(config_.scene.colours.at(solid.colour)) << " contype=\"" << bits::kFurniture
         << "\" conaffinity=\"0\"";
    if (solid.handle) out_ << kGrip << " friction=\"1 0.01 0.0002\"";
    out_ << "/>\n";
  }

  void write_unit(const Unit& unit) {
    out_ << "<body name=\"" << unit.name << '"' << pose(unit.X_SU) << ">\n";
    for (const Solid& solid : unit.solids) write_solid(solid);
    for (const Part& part : unit.parts) {
      const PartJoint& j = part.joint;
      out_ << "<body name=\"" << part.name << "\" pos=\"" << text(part.p_U) << "\">\n<joint name=\""
           << part.name << "\" type=\"" << (j.revolute ? "hinge" : "slide") << "\" axis=\""
           << text(j.axis) << "\" range=\"0 " << j.range << "\" damping=\"" << j.damping
           << "\" frictionloss=\"" << j.friction << "\" stiffness=\"" << j.stiffness
           << "\" armature=\"" << j.armature << "\"/>\n<inertial pos=\"" << text(part.com)
           << "\" mass=\"" << part.mass_kg << "\" diaginertia=\"" << text(part.inertia) << "\"/>\n";
      for (const Solid& solid : part.solids) write_solid(solid);
      out_ << "</body>\n";
    }
    out_ << "</body>\n";
  }

  // A link, and everything that hangs on it.
  void write_link(const urdf::Link& link) {
    out_ << "<body name=\"" << link.name << '"';
    if (link.parent_joint) {
      out_ << pose(to_eigen(link.parent_joint->parent_to_joint_origin_transform)) << ">\n";
      if (is_movable(*link.parent_joint)) write_joint(*link.parent_joint);
    } else {
      out_ << ">\n";
      if (config_.robot.base.kind != BaseKind::kFixed)
        out_ << "<freejoint name=\"" << link.name << "\"/>\n";
    }
    if (link.inertial) write_inertial(*link.inertial);
    for (std::size_t i = 0; i < link.collision_array.size(); ++i) {
      const urdf::Collision& c = *link.collision_array[i];
      write_collision(link, c, c.name.empty() ? link.name + "_" + std::to_string(i) : c.name);
    }
    for (const urdf::LinkSharedPtr& child : link.child_links) write_link(*child);
    out_ << "</body>\n";
  }

  void write_inertial(const urdf::Inertial& inertial) {
    // MuJoCo takes a full inertia in the body's axes only.
    const Isometry3d X = to_eigen(inertial.origin);
    Eigen::Matrix3d I;
    I << inertial.ixx, inertial.ixy, inertial.ixz, inertial.ixy, inertial.iyy, inertial.iyz,
        inertial.ixz, inertial.iyz, inertial.izz;
    I = X.linear() * I * X.linear().transpose();
    out_ << "<inertial pos=\"" << text(X.translation()) << "\" mass=\"" << inertial.mass
         << "\" fullinertia=\"" << I(0, 0) << ' ' << I(1, 1) << ' ' << I(2, 2) << ' ' << I(0, 1)
         << ' ' << I(0, 2) << ' ' << I(1, 2) << "\"/>\n";
  }

  double armature(const std::string& joint) const {
    const RobotConfig& robot = config_.robot;
    for (std::size_t i = 0; i < robot.joints.size(); ++i) {
      if (robot.joints[i].name == joint) return config_.sim.joints[i].armature;
    }
    if (is_wheel(joint)) return config_.sim.wheels.armature;
    const bool finger = std::count(robot.fingers.begin(), robot.fingers.end(), joint) > 0;
    return finger ? config_.sim.gripper.armature_kg : 0.0;
  }
  bool is_wheel(const std::string& joint) const {
    const std::vector<std::string>& wheels = config_.robot.base.wheels;
    return std::count(wheels.begin(), wheels.end(), joint) > 0;
  }

  void write_joint(const urdf::Joint& joint) {
    const bool slide = joint.type == urdf::Joint::PRISMATIC;
    out_ << "<joint name=\"" << joint.name << "\" type=\"" << (slide ? "slide" : "hinge")
         << "\" axis=\"" << text(to_eigen(joint.axis)) << "\" armature=\"" << armature(joint.name)
         << '"';
    if (joint.type != urdf::Joint::CONTINUOUS)
      out_ << " range=\"" << joint.limits->lower << ' ' << joint.limits->upper << '"';
    if (joint.dynamics)
      out_ << " damping=\"" << joint.dynamics->damping << "\" frictionloss=\""
           << joint.dynamics->friction << '"';
    out_ << "/>\n";
    actuators_ << "<motor name=\"" << joint.name << "\" joint=\"" << joint.name << "\" ctrlrange=\""
               << -joint.limits->effort << ' ' << joint.limits->effort << "\"/>\n";
  }

  void write_collision(const urdf::Link& link, const urdf::Collision& collision,
                       const std::string& name) {
    const bool wheel = link.parent_joint && is_wheel(link.parent_joint->name);
    const auto listed = [&](const std::vector<std::string>& names) {
      return std::count(names.begin(), names.end(), name) > 0;
    };
    out_ << "<geom name=\"" << name << '"' << shape(collision, wheel)
         << pose(to_eigen(collision.origin));
    const auto colour = config_.sim.colours.find(link.name);
    out_ << rgba(colour == config_.sim.colours.end() ? config_.sim.colours.at("default")
                                                     : colour->second);
    if (wheel && config_.robot.base.kind == BaseKind::kOmnidirectional) {
      // Smooth: Rollers adds what friction does.
      out_ << " contype=\"0\" conaffinity=\"" << (bits::kFurniture | bits::kFloor)
           << "\" priority=\"1\" solref=\"0.01 1\" condim=\"1\"";
    } else if (wheel || listed(config_.sim.castors.collisions)) {
      // The higher priority lets the wheel's own friction count, not the floor's.
      out_ << " contype=\"0\" conaffinity=\"" << (bits::kFurniture | bits::kFloor)
           << "\" priority=\"1\" solref=\"0.01 1\" friction=\""
           << triple(wheel ? config_.sim.wheels.friction : config_.sim.castors.friction) << '"';
    } else {
      out_ << " contype=\"" << bits::kRobot << "\" conaffinity=\""
           << (bits::kFurniture | bits::kRobot | bits::kFloor) << '"';
      if (listed(config_.sim.gripper.pads))
        out_ << kGrip << " priority=\"1\" friction=\"" << triple(config_.sim.gripper.friction)
             << '"';
    }
    out_ << "/>\n";
  }

  std::string shape(const urdf::Collision& collision, bool wheel) const {
    std::ostringstream s;
    s << std::setprecision(17) << " type=\"";
    if (const auto box = std::dynamic_pointer_cast<urdf::Box>(collision.geometry)) {
      s << "box\" size=\"" << text(0.5 * to_eigen(box->dim)) << '"';
    } else if (const auto cylinder =
                   std::dynamic_pointer_cast<urdf::Cylinder>(collision.geometry)) {
      const double r = cylinder->radius, h = 0.5 * cylinder->length;
      s << (wheel ? "ellipsoid\" size=\"" + text({r, r, h})
                  : "cylinder\" size=\"" + text({r, h, 0}))
        << '"';
    } else if (const auto sphere = std::dynamic_pointer_cast<urdf::Sphere>(collision.geometry)) {
      s << "sphere\" size=\"" << sphere->radius << '"';
    } else {
      throw config::ConfigError(config_.robot.urdf.string() + ": collision '" + collision.name +
                                "' must be a box, cylinder or sphere");
    }
    return s.str();
  }

  // The two fingers mirror each other, as a real parallel gripper's do; mimic joints follow their
  // masters.
  void write_equality() {
    out_ << "<equality>\n";
    const std::vector<std::string>& fingers = config_.robot.fingers;
    if (fingers.size() == 2) write_coupling(fingers[0], fingers[1], 0, 1);
    for (const auto& [name, joint] : urdf_->joints_) {
      if (joint->mimic && std::count(fingers.begin(), fingers.end(), name) == 0)
        write_coupling(name, joint->mimic->joint_name, joint->mimic->offset,
                       joint->mimic->multiplier);
    }
    out_ << "</equality>\n";
  }
  void write_coupling(const std::string& joint, const std::string& master, double offset,
                      double multiplier) {
    out_ << "<joint joint1=\"" << joint << "\" joint2=\"" << master << "\" polycoef=\"" << offset
         << ' ' << multiplier << " 0 0 0\" solref=\"0.005 1\"/>\n";
  }

  void write_excludes() {
    out_ << "<contact>\n";
    for (const auto& [a, b] : config_.robot.contact_excluded)
      out_ << "<exclude body1=\"" << a << "\" body2=\"" << b << "\"/>\n";
    out_ << "</contact>\n";
  }

  const PluginConfig& config_;
  urdf::ModelInterfaceSharedPtr urdf_;
  std::ostringstream out_;
  std::ostringstream actuators_;
};

}  // namespace

std::string to_mjcf(const PluginConfig& config) { return Writer(config).write(); }

ModelPtr compile(const std::string& mjcf) {
  constexpr const char* kFile = "model.xml";
  const auto vfs = std::make_unique<mjVFS>();  // 800 kB: too large for a stack
  mj_defaultVFS(vfs.get());
  if (mj_makeEmptyFileVFS(vfs.get(), kFile, static_cast<int>(mjcf.size())) != 0) {
    throw config::ConfigError(
        "the simulated model's text does not fit MuJoCo's virtual file system");
  }
  std::memcpy(vfs->filedata[0], mjcf.data(), mjcf.size());
  char error[1000] = "";
  ModelPtr model(mj_loadXML(kFile, vfs.get(), error, sizeof(error)));
  mj_deleteVFS(vfs.get());
  if (!model)
    throw config::ConfigError(std::string("MuJoCo refuses the generated model: ") + error);
  return model;
}

}  // namespace wb::sim
