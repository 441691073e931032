#include "daemon/truth_tap.hpp"

#include <cstdio>
#include <stdexcept>

namespace wb {

Eigen::Isometry3d isometry(const wb_sim_pose& pose) {
  return Pose{{pose.p[0], pose.p[1], pose.p[2]}, {pose.q[0], pose.q[1], pose.q[2], pose.q[3]}}
      .isometry();
}

wb_sim_pose sim_pose(const Eigen::Isometry3d& X) {
  const Pose p = Pose::from(X);
  return {{p.p[0], p.p[1], p.p[2]}, {p.q[0], p.q[1], p.q[2], p.q[3]}};
}

namespace {

MaskBox mask(const wb_sim_box& box) {
  return {true,
          Pose::from(isometry(box.X_SM)),
          {box.half_extent[0], box.half_extent[1], box.half_extent[2]}};
}

}  // namespace

TruthTap::TruthTap(const DriverHost& host, std::string shoulder_camera)
    : truth_(static_cast<const wb_sim_truth*>(host.extension(WB_SIM_TRUTH, &driver_))),
      shoulder_camera_(std::move(shoulder_camera)) {
  if (!truth_)
    throw std::runtime_error(
        "interpreter 'oracle' needs a driver with the extension " WB_SIM_TRUTH);
}

void TruthTap::sample(TimeNs t) RT_SAFE {
  if (t < next_) return;
  next_ = t + kPeriod_ns;
  Sample& s = samples_.writing();
  wb_sim_pose camera;
  if (truth_->link_pose(driver_, shoulder_camera_.c_str(), &camera) != WB_OK) return;
  const Eigen::Isometry3d X_SC = isometry(camera);
  s.count = 0;
  for (std::uint32_t i = 0; i < truth_->object_count(driver_) && s.count < kMaxObjects; ++i) {
    wb_sim_object o;
    if (truth_->object(driver_, i, &o) != WB_OK) continue;
    s.names[s.count] = Name(o.name);
    ObjectTruth& out = s.objects[s.count++];
    out.articulation.kind = o.is_revolute ? JointKind::kRevolute : JointKind::kPrismatic;
    for (int k = 0; k < 3; ++k) {
      out.articulation.axis_origin[k] = o.axis_origin[k];
      out.articulation.axis[k] = o.axis[k];
    }
    out.articulation.value = o.value;
    out.articulation.range = o.range;
    out.X_SG = isometry(o.X_SG);
    out.handle_radius_m = o.handle_radius;
    out.handle_length_m = o.handle_length;
    out.masks = {mask(o.carcass), mask(o.moving)};
    out.X_SC = X_SC;
  }
  const std::uint32_t touches = truth_->contact_count(driver_);
  s.contact_count = 0;
  wb_sim_contact c;
  for (std::uint32_t i = 0; i < touches && s.contact_count < static_cast<int>(s.contacts.size());
       ++i) {
    if (truth_->contact(driver_, i, &c) == WB_OK)
      s.contacts[s.contact_count++] = {Name(c.robot_geom), Name(c.other_geom)};
  }
  samples_.publish();
}

bool TruthTap::find(const Name& object, ObjectTruth& truth) {
  const Sample* s = samples_.read(0);
  for (int i = 0; s && i < s->count; ++i) {
    if (!(s->names[i] == object)) continue;
    truth = s->objects[i];
    return true;
  }
  return false;
}

void TruthTap::show(ServiceSnapshot& out) {
  const Sample* s = samples_.read(1);
  if (!s) return;
  out.truth_joint_count = s->count;
  for (int i = 0; i < s->count; ++i)
    out.truth_joints[i] = {s->names[i], s->objects[i].articulation.value};
  out.truth_contact_count = s->contact_count;
  out.truth_contacts = s->contacts;
}

std::string TruthTap::summary() const {
  constexpr double kOpenFraction = 0.01;  // a shut door rattles by less
  std::string text;
  char part[128];
  wb_sim_object o;
  for (std::uint32_t i = 0; i < truth_->object_count(driver_); ++i) {
    if (truth_->object(driver_, i, &o) != WB_OK || o.value < kOpenFraction * o.range) continue;
    std::snprintf(part, sizeof part, "%s at %.3f of %.3f %s, ", o.name, o.value, o.range,
                  o.is_revolute ? "rad" : "m");
    text += part;
  }
  const std::uint32_t touches = truth_->contact_count(driver_);
  text += std::to_string(touches) + (touches == 1 ? " collision" : " collisions");
  wb_sim_contact c;
  if (touches && truth_->contact(driver_, 0, &c) == WB_OK)
    text += std::string(" (first: ") + c.robot_geom + " against " + c.other_geom + ")";
  return text;
}

std::set<std::string> TruthTap::object_names() const {
  std::set<std::string> names;
  for (std::uint32_t i = 0; i < truth_->object_count(driver_); ++i) {
    wb_sim_object o;
    if (truth_->object(driver_, i, &o) == WB_OK) names.insert(o.name);
  }
  return names;
}

}  // namespace wb
