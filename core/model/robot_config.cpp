#include "core/model/robot_config.hpp"

#include <algorithm>

#include "core/config/config.hpp"
#include "core/model/urdf_file.hpp"
#include "core/types/limits.hpp"

namespace wb {
namespace {

using config::Section;

// The names that robot.yaml may use, and what it must hold to be one robot with its URDF.
class Checker {
 public:
  explicit Checker(const std::filesystem::path& urdf_file) : urdf_(read_urdf(urdf_file)) {}

  const urdf::ModelInterface& urdf() const { return *urdf_; }

  std::string link(const Section& s, const std::string& key) const {
    return known_link(s, key, s.text(key));
  }
  std::string known_link(const Section& s, const std::string& key, const std::string& name) const {
    if (!urdf_->getLink(name)) s.fail(key, "names '" + name + "', which is no link of the URDF");
    return name;
  }
  const urdf::Joint& joint(const Section& s, const std::string& key,
                           const std::string& name) const {
    const urdf::JointConstSharedPtr joint = urdf_->getJoint(name);
    if (!joint) s.fail(key, "names '" + name + "', which is no joint of the URDF");
    return *joint;
  }

 private:
  urdf::ModelInterfaceSharedPtr urdf_;
};

void check_unique(const Section& s, const std::string& key, std::vector<std::string> names) {
  std::sort(names.begin(), names.end());
  const auto twice = std::adjacent_find(names.begin(), names.end());
  if (twice != names.end()) s.fail(key, "holds '" + *twice + "' twice");
}

BaseConfig load_base(const Section& s, const Checker& check) {
  BaseConfig base;
  base.link = check.link(s, "link");
  if (base.link != check.urdf().getRoot()->name) {
    s.fail("link", "must be the URDF's root link, '" + check.urdf().getRoot()->name + "'");
  }
  base.bounding_radius_m = s.number("bounding_radius_m", config::kPositive);
  const std::string kind = s.one_of("kind", {"fixed", "differential_drive", "omnidirectional"});
  if (kind != "fixed") {
    const bool omnidirectional = kind == "omnidirectional";
    base.kind = omnidirectional ? BaseKind::kOmnidirectional : BaseKind::kDifferentialDrive;
    base.wheels = s.texts("wheels");
    if (base.wheels.size() != (omnidirectional ? 4 : 2)) {
      s.fail("wheels", omnidirectional ? "must hold four joints: front left, front right, rear "
                                         "left, rear right"
                                       : "must hold two joints, left and right");
    }
    check_unique(s, "wheels", base.wheels);
    for (const std::string& wheel : base.wheels) {
      if (check.joint(s, "wheels", wheel).type != urdf::Joint::CONTINUOUS) {
        s.fail("wheels", "names '" + wheel + "', which does not turn without limits");
      }
    }
    if (omnidirectional) base.wheelbase_m = s.number("wheelbase_m", config::kPositive);
    base.wheel_radius_m = s.number("wheel_radius_m", config::kPositive);
    base.track_m = s.number("track_m", config::kPositive);
    base.velocity_max = s.number("velocity_max_mps", config::kPositive);
    base.yaw_rate_max = s.number("yaw_rate_max_radps", config::kPositive);
    base.acceleration_max = s.number("acceleration_max_mps2", config::kPositive);
    base.yaw_acceleration_max = s.number("yaw_acceleration_max_radps2", config::kPositive);
  }
  s.finish();
  return base;
}

JointConfig load_joint(const Section& s, const Checker& check) {
  JointConfig out;
  out.name = s.text("name");
  const urdf::Joint& joint = check.joint(s, "name", out.name);
  const bool endless = joint.type == urdf::Joint::CONTINUOUS;
  if ((joint.type != urdf::Joint::REVOLUTE && joint.type != urdf::Joint::PRISMATIC && !endless) ||
      !joint.limits) {
    s.fail("name", "names '" + out.name +
                       "', which is not a revolute, continuous or prismatic joint with limits");
  }
  if (joint.mimic) {
    s.fail("name", "names '" + out.name + "', which follows " + joint.mimic->joint_name +
                       " by itself (mimic): leave it out");
  }
  const urdf::JointLimits& limits = *joint.limits;
  if ((!endless && limits.lower >= limits.upper) || limits.velocity <= 0 || limits.effort <= 0) {
    s.fail("name", "names '" + out.name + "', whose limits in the URDF are empty: lower " +
                       std::to_string(limits.lower) + ", upper " + std::to_string(limits.upper) +
                       ", velocity " + std::to_string(limits.velocity) + ", effort " +
                       std::to_string(limits.effort));
  }
  out.acceleration_max = s.number("acceleration_max_radps2", config::kPositive);
  // Slower than the URDF says, never faster.
  out.velocity_max = s.number_or("velocity_max_radps", 0.0, {0.0, limits.velocity});
  s.finish();
  return out;
}

CameraConfig load_camera(const Section& s, const Checker& check) {
  CameraConfig camera;
  camera.name = check.link(s, "name");
  CameraIntrinsics& k = camera.intrinsics;
  k.width = s.integer("width", config::kPositive);
  k.height = s.integer("height", config::kPositive);
  k.fx = s.number("fx", config::kPositive);
  k.fy = s.number("fy", config::kPositive);
  k.cx = s.number("cx", {0.0, static_cast<double>(k.width)});
  k.cy = s.number("cy", {0.0, static_cast<double>(k.height)});
  k.range_min_m = s.number("range_min_m", config::kPositive);
  k.range_max_m = s.number("range_max_m", {k.range_min_m});
  camera.rate_hz = s.number("rate_hz", config::kPositive);
  s.finish();
  return camera;
}

SphereConfig load_sphere(const Section& s, const Checker& check) {
  SphereConfig sphere;
  sphere.link = check.link(s, "link");
  sphere.centre = s.vector3("centre_m");
  sphere.radius = s.number("radius_m", config::kPositive);
  sphere.masked = s.boolean("masked");
  s.finish();
  return sphere;
}

CapsuleConfig load_capsule(const Section& s, const Checker& check) {
  CapsuleConfig capsule;
  capsule.name = s.text("name");
  capsule.link = check.link(s, "link");
  capsule.p0 = s.vector3("p0_m");
  capsule.p1 = s.vector3("p1_m");
  capsule.radius = s.number("radius_m", config::kPositive);
  s.finish();
  return capsule;
}

// A posture of all joints, inside the limits of the URDF.
std::vector<double> load_posture(const Section& s, const std::string& key, const Checker& check,
                                 const std::vector<JointConfig>& joints) {
  const std::vector<double> q = s.numbers(key, static_cast<int>(joints.size()));
  for (std::size_t i = 0; i < q.size(); ++i) {
    const urdf::Joint& joint = *check.urdf().getJoint(joints[i].name);
    const urdf::JointLimits& limits = *joint.limits;
    if (joint.type == urdf::Joint::CONTINUOUS) continue;
    if (q[i] < limits.lower || q[i] > limits.upper) {
      s.fail(key, "puts " + joints[i].name + " at " + std::to_string(q[i]) + ", allowed: " +
                      std::to_string(limits.lower) + " to " + std::to_string(limits.upper));
    }
  }
  return q;
}

}  // namespace

RobotConfig RobotConfig::load(const std::filesystem::path& folder) {
  const Section s = Section::open(folder / "robot.yaml");
  RobotConfig out;
  out.folder = folder;
  out.name = s.text("name");
  out.urdf = s.file("urdf");
  const Checker check(out.urdf);
  out.base = load_base(s.section("base"), check);

  std::vector<std::string> used = out.base.wheels;
  for (const Section& joint : s.sections("joints")) {
    out.joints.push_back(load_joint(joint, check));
    used.push_back(out.joints.back().name);
  }
  const int states =
      (out.base.kind == BaseKind::kFixed ? 0 : 3) + static_cast<int>(out.joints.size());
  if (states > kMaxStates || out.joints.size() > kMaxJoints) {
    s.fail("joints", "makes a state of " + std::to_string(states) +
                         " entries, allowed: " + std::to_string(kMaxStates));
  }
  out.fingers = s.texts("fingers");
  for (const std::string& finger : out.fingers) {
    if (check.joint(s, "fingers", finger).type != urdf::Joint::PRISMATIC) {
      s.fail("fingers", "names '" + finger + "', which is not prismatic");
    }
    used.push_back(finger);
  }
  check_unique(s, "joints", used);
  out.gripper_opening_max_m = s.number("gripper_opening_max_m", config::kNonNegative);
  out.end_effector = check.link(s, "end_effector");
  if (s.has("more_end_effectors")) {
    out.more_end_effectors = s.texts("more_end_effectors");
    for (const std::string& link : out.more_end_effectors)
      check.known_link(s, "more_end_effectors", link);
    if (out.more_end_effectors.size() >= kMaxEndEffectors)
      s.fail("more_end_effectors", "allowed: at most " + std::to_string(kMaxEndEffectors - 1));
  }
  out.stowed = load_posture(s, "stowed_rad", check, out.joints);
  out.ready = load_posture(s, "ready_rad", check, out.joints);

  std::vector<std::string> names;
  for (const Section& camera : s.sections("cameras")) {
    out.cameras.push_back(load_camera(camera, check));
    names.push_back(out.cameras.back().name);
  }
  check_unique(s, "cameras", names);
  if (names.size() > kMaxCameras)
    s.fail("cameras", "holds more than " + std::to_string(kMaxCameras));
  out.shoulder_camera = s.one_of("shoulder_camera", names);

  for (const Section& sphere : s.sections("collision_spheres")) {
    out.spheres.push_back(load_sphere(sphere, check));
  }
  names.clear();
  for (const Section& capsule : s.sections("collision_capsules")) {
    out.capsules.push_back(load_capsule(capsule, check));
    names.push_back(out.capsules.back().name);
  }
  check_unique(s, "collision_capsules", names);
  out.self_pairs = s.text_pairs("self_collision_pairs");
  for (const auto& pair : out.self_pairs) {
    for (const std::string& name : pair) {
      if (std::find(names.begin(), names.end(), name) == names.end()) {
        s.fail("self_collision_pairs", "names '" + name + "', which is none of collision_capsules");
      }
    }
    if (pair[0] == pair[1]) s.fail("self_collision_pairs", "pairs '" + pair[0] + "' with itself");
  }
  out.contact_excluded = s.text_pairs("contact_excluded");
  for (const auto& pair : out.contact_excluded) {
    for (const std::string& name : pair) check.known_link(s, "contact_excluded", name);
  }
  s.finish();
  return out;
}

}  // namespace wb
