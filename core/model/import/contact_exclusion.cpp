#include "core/model/import/contact_exclusion.hpp"

#include <algorithm>
#include <cmath>
#include <random>

namespace wb {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

// The joint that moves a link's rigid group; empty for the base's.
const UrdfJoint* mover(const UrdfDocument& document, const std::string& link) {
  const UrdfJoint* up = document.joint_above(link);
  while (up != nullptr && !up->movable()) up = document.joint_above(up->parent);
  return up;
}

bool touches(const UrdfLink& a, const UrdfLink& b, const Isometry3d& X_AB) {
  for (const UrdfCollision& cb : b.collisions) {
    for (const Vector3d& p : cb.solid.surface(0.03)) {
      for (const UrdfCollision& ca : a.collisions) {
        if (ca.solid.distance(X_AB * p) < 0) return true;
      }
    }
  }
  return false;
}

double overlap(const RobotModel& model, std::uint64_t seed, const UrdfLink& a, const UrdfLink& b) {
  const ArmRange range = arm_range(model);
  const int fa = model.frame(a.name), fb = model.frame(b.name);
  std::mt19937_64 random(seed);
  int overlapping = 0;
  constexpr int kPostures = 24;
  for (int k = 0; k < kPostures; ++k) {
    std::vector<double> q = k == 0 ? model.config().stowed : model.config().ready;
    for (std::size_t j = 0; j < q.size() && k > 1; ++j) {
      const double share = static_cast<double>(random() >> 11) * 0x1.0p-53;
      q[j] = range.lower[j] + share * (range.upper[j] - range.lower[j]);
    }
    const RobotModel::Data data = arm_data(model, q);
    const Isometry3d X_AB = model.X_WF(fa, data).inverse() * model.X_WF(fb, data);
    const bool hit = touches(a, b, X_AB) || touches(b, a, X_AB.inverse());
    if (hit && k < 2) return 1;  // the postures that it rests in
    overlapping += hit;
  }
  return static_cast<double>(overlapping) / kPostures;
}

std::string excuse(const UrdfDocument& document, const RobotStructure& structure,
                   const RobotModel& model, std::uint64_t seed, const UrdfLink& a,
                   const UrdfLink& b) {
  const UrdfJoint *ja = mover(document, a.name), *jb = mover(document, b.name);
  if (ja == jb) return "one rigid body";
  if (jb != nullptr && mover(document, jb->parent) == ja) return "adjacent: " + jb->name;
  if (ja != nullptr && mover(document, ja->parent) == jb) return "adjacent: " + ja->name;
  const auto& fingers = structure.fingers;
  const auto finger = [&](const UrdfJoint* j) {
    return j && std::find(fingers.begin(), fingers.end(), j->name) != fingers.end();
  };
  if (finger(ja) && finger(jb)) return "the fingers meet when the gripper closes";
  const double share = overlap(model, seed, a, b);
  if (share > 0.5)
    return "their shapes overlap in " + std::to_string(std::lround(100 * share)) +
           " % of the postures";
  return "";
}

}  // namespace

std::vector<ExcludedContact> excluded_contacts(const UrdfDocument& document,
                                               const RobotStructure& structure,
                                               const RobotModel& model, std::uint64_t seed) {
  std::vector<ExcludedContact> out;
  std::vector<const UrdfLink*> shaped;
  for (const UrdfLink& link : document.links) {
    if (!link.collisions.empty()) shaped.push_back(&link);
  }
  for (std::size_t i = 0; i < shaped.size(); ++i) {
    for (std::size_t k = i + 1; k < shaped.size(); ++k) {
      const std::string reason = excuse(document, structure, model, seed, *shaped[i], *shaped[k]);
      if (!reason.empty()) out.push_back({shaped[i]->name, shaped[k]->name, reason});
    }
  }
  return out;
}

}  // namespace wb
