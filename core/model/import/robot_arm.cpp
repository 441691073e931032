// find_arm: the hand, the joints that lead to it, its fingers, and frame E.
#include <algorithm>
#include <cmath>
#include <sstream>

#include "core/model/import/robot_structure.hpp"
#include "core/types/limits.hpp"

namespace wb {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

// Names of hands, best first: ROS's tool frames, then hands, then flanges.
const std::vector<std::vector<std::string>> kHands = {{"end_effector", "endeffector", "tcp"},
                                                      {"tool", "grasp_frame", "grasping_frame"},
                                                      {"ee_link", "_ee"},
                                                      {"hand", "gripper"},
                                                      {"flange"}};

// By its name; or it slides, and moves with another that does.
bool is_finger(const UrdfDocument& document, const UrdfJoint& j) {
  if (contains_any(j.name, {"finger", "gripper", "knuckle", "jaw"})) return true;
  if (j.type != UrdfJoint::Type::kPrismatic) return false;
  return j.mimic ||
         std::any_of(document.joints.begin(), document.joints.end(),
                     [&](const UrdfJoint& o) { return o.mimic && o.mimic->joint == j.name; });
}

struct Candidate {
  const UrdfLink* link = nullptr;
  int joints = 0;        // movable ones above it
  std::size_t rank = 0;  // by name, best is 0
  double away = 0;       // path length [m]
};

// Of the links behind arm joints, the best name; then most joints, then furthest.
std::vector<Candidate> candidates(const UrdfDocument& document, const RobotStructure& out) {
  std::vector<Candidate> all;
  for (const UrdfLink& link : document.links) {
    Candidate c{&link};
    bool hand = true;
    for (const UrdfJoint* j : document.path_to(link.name)) {
      const bool wheel =
          std::find(out.wheels.begin(), out.wheels.end(), j->name) != out.wheels.end();
      c.joints += j->movable();
      c.away += j->X_PC.translation().norm();
      hand &= !wheel && !(j->movable() && is_finger(document, *j));
    }
    if (!hand || c.joints == 0 || contains_any(link.name, {"camera", "imu", "finger"})) continue;
    c.rank = kHands.size();
    for (std::size_t i = kHands.size(); i-- > 0;) {
      if (contains_any(link.name, kHands[i])) c.rank = i;
    }
    all.push_back(c);
  }
  std::stable_sort(all.begin(), all.end(), [](const Candidate& a, const Candidate& b) {
    if ((a.joints > 1) != (b.joints > 1)) return a.joints > 1;  // one joint alone: a neck, a lift
    if (a.rank != b.rank) return a.rank < b.rank;
    if (a.joints != b.joints) return a.joints > b.joints;
    return a.away > b.away + 1e-6;
  });
  return all;
}

// Among the axes of a frame, with either sign, the one nearest to a direction.
Vector3d nearest_axis(const Vector3d& direction) {
  int k = 0;
  direction.cwiseAbs().maxCoeff(&k);
  return (direction[k] < 0 ? -1.0 : 1.0) * Vector3d::Unit(k);
}

void find_fingers(const UrdfDocument& document, const std::string& carrier, RobotStructure& out) {
  bool turning = false;
  for (const UrdfJoint& j : document.joints) {
    if (!j.movable() || !document.is_below(j.parent, carrier)) continue;
    const auto between = document.path_to(j.parent);
    const bool behind_another = std::any_of(
        between.begin(), between.end(),
        [&](const UrdfJoint* b) { return b->movable() && document.is_below(b->parent, carrier); });
    if (j.type != UrdfJoint::Type::kPrismatic || behind_another) {
      turning = true;
      continue;
    }
    out.fingers.push_back(j.name);
    out.gripper_opening_m += j.limit->upper - std::max(0.0, j.limit->lower);
  }
  if (turning) {
    out.notes.push_back(
        "gripper: only fingers that slide on the hand can be driven; what turns in "
        "it stays as it is");
  }
  if (out.fingers.size() == 1 || out.fingers.size() == 2) {
    std::ostringstream text;
    text << "gripper: " << out.fingers.front()
         << (out.fingers.size() == 2 ? " and " + out.fingers.back() : "") << ", opening "
         << out.gripper_opening_m << " m";
    out.notes.push_back(text.str());
  } else if (!out.fingers.empty()) {
    out.notes.push_back("gripper: " + std::to_string(out.fingers.size()) +
                        " sliding fingers, and one or two are understood; they stay as they are");
    out.fingers.clear();
    out.gripper_opening_m = 0;
  } else {
    out.notes.push_back("gripper: none, since nothing slides on the hand");
  }
}

// E: z approaches, y along the fingers' stroke, origin between the pads.
void place_end_effector(UrdfDocument& document, const std::string& carrier, RobotStructure& out) {
  const auto poses = document.poses();
  const Isometry3d X_RH = poses.at(out.end_effector);
  const Isometry3d X_HR = X_RH.inverse();
  Vector3d z = Vector3d::UnitZ(), y = Vector3d::UnitY(), p = Vector3d::Zero();
  if (!out.fingers.empty()) {
    Vector3d roots = Vector3d::Zero(), middle = Vector3d::Zero(), stroke = Vector3d::Zero();
    std::vector<Vector3d> surface;
    for (const std::string& name : out.fingers) {
      const UrdfJoint& j = *document.joint(name);
      const Isometry3d X_HF = X_HR * poses.at(j.child);
      roots += X_HF.translation() / static_cast<double>(out.fingers.size());
      stroke = X_HF.linear() * j.axis;
      for (const UrdfCollision& c : document.link(j.child).collisions) {
        for (const Vector3d& q : c.solid.surface(0.005)) surface.push_back(X_HF * q);
      }
    }
    y = nearest_axis(stroke);
    if (y.sum() < 0) y = -y;
    for (const Vector3d& q : surface) middle += q / static_cast<double>(surface.size());
    // From the wrist to the fingers; the part across the stroke.
    const Vector3d wrist = (X_HR * poses.at(carrier)).translation();
    Vector3d along = (surface.empty() ? roots : middle) - wrist;
    along -= along.dot(y) * y;
    if (along.norm() > 0.01) z = nearest_axis(along);
    if (std::abs(z.dot(y)) > 0.5) z = y.unitOrthogonal();
    double tip = roots.dot(z);
    for (const Vector3d& q : surface) tip = std::max(tip, q.dot(z));
    const Vector3d between = roots + (tip - 0.01 - roots.dot(z)) * z;  // a pad's half length back
    if ((between - p).norm() > 0.03) p = between;
  } else {
    // Old tool frames have x where the tool points.
    const Vector3d out_of_wrist = -(X_HR * poses.at(carrier)).translation();
    const Vector3d axis = nearest_axis(out_of_wrist);
    if (out_of_wrist.norm() > 0.02 && out_of_wrist.normalized().dot(axis) > 0.9) z = axis;
    if (std::abs(z.dot(y)) > 0.5)
      y = z == -Vector3d::UnitY() ? Vector3d::UnitX() : Vector3d::UnitZ();
  }
  Isometry3d X_HE = Isometry3d::Identity();
  X_HE.linear().col(1) = y;
  X_HE.linear().col(2) = z;
  X_HE.linear().col(0) = y.cross(z);
  X_HE.translation() = p;
  if (X_HE.isApprox(Isometry3d::Identity(), 1e-6)) return;
  const std::string hand = out.end_effector;
  out.end_effector = add_frame(document, "end_effector", hand, X_HE);
  std::ostringstream text;
  text << "end effector: link " << out.end_effector << " is new on " << hand << " at (" << p.x()
       << ", " << p.y() << ", " << p.z() << ") m: z approaches"
       << (out.fingers.empty() ? "" : ", y along the fingers' stroke, between the pads");
  out.notes.push_back(text.str());
}

}  // namespace

void find_arm(UrdfDocument& document, const StructureOptions& options, RobotStructure& out) {
  const std::vector<Candidate> all = candidates(document, out);
  const int root_line = document.link(document.root).line;
  if (all.empty()) {
    document.fail(root_line,
                  "no joint moves a link that could be a hand: there is no arm to control");
  }
  if (options.end_effector.empty()) {
    out.end_effector = all[0].link->name;
    std::string text = "end effector: link " + out.end_effector + ", by its " +
                       (all[0].rank < kHands.size() ? "name" : "distance from the base");
    // Another arm with a hand as good?
    for (const Candidate& c : all) {
      if (c.rank != all[0].rank || c.joints != all[0].joints) continue;
      if (document.is_below(c.link->name, out.end_effector) ||
          document.is_below(out.end_effector, c.link->name))
        continue;
      text += "; " + c.link->name + " would do as well (one arm is controlled: --end-effector)";
      break;
    }
    out.notes.push_back(text);
  } else {
    const bool known = std::any_of(document.links.begin(), document.links.end(),
                                   [&](auto& l) { return l.name == options.end_effector; });
    if (!known) {
      document.fail(root_line, "the file has no link '" + options.end_effector +
                                   "', which --end-effector names");
    }
    out.end_effector = options.end_effector;
    out.notes.push_back("end effector: link " + out.end_effector +
                        ", as asked for: its z must approach, its y lie along the fingers' stroke");
  }

  std::string carrier = document.root;  // what the last joint moves
  for (const UrdfJoint* j : document.path_to(out.end_effector)) {
    if (!j->movable()) continue;
    if (j->type == UrdfJoint::Type::kPlanar || j->type == UrdfJoint::Type::kFloating) {
      document.fail(j->line, "joint '" + j->name +
                                 "' is planar or floating inside the arm; split it into "
                                 "simple joints");
    }
    if (j->mimic) {
      document.fail(j->line,
                    "joint '" + j->name + "' mimics '" + j->mimic->joint +
                        "' inside the arm; coupled arm joints cannot be controlled: remove "
                        "the <mimic>, or make it fixed");
    }
    out.joints.push_back(j->name);
    carrier = j->child;
  }
  if (out.joints.empty()) {
    document.fail(root_line, "no joint moves link '" + out.end_effector +
                                 "'; name another one with --end-effector");
  }
  const int states =
      (out.base == ImportedBase::kFixed ? 0 : 3) + static_cast<int>(out.joints.size());
  if (states > kMaxStates) {
    document.fail(document.joint(out.joints.back())->line,
                  "the arm makes a state of " + std::to_string(states) + " entries, allowed: " +
                      std::to_string(kMaxStates) + "; name a nearer --end-effector, or fix joints");
  }
  std::string names;
  for (const std::string& j : out.joints) names += (names.empty() ? "" : ", ") + j;
  out.notes.push_back("arm: " + std::to_string(out.joints.size()) + " joints: " + names);
  find_fingers(document, carrier, out);
  if (options.end_effector.empty()) place_end_effector(document, carrier, out);
}

}  // namespace wb
