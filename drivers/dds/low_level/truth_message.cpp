#include "drivers/dds/low_level/truth_message.hpp"

namespace wb::dds {
namespace {

msg::TruthPose to_message(const wb_sim_pose& X) {
  msg::TruthPose out;
  std::copy_n(X.p, 3, out.p_);
  std::copy_n(X.q, 4, out.q_);
  return out;
}

msg::TruthBox to_message(const wb_sim_box& box) {
  msg::TruthBox out{to_message(box.X_SM), {}};
  std::copy_n(box.half_extent, 3, out.half_extent_);
  return out;
}

}  // namespace

TruthMessage::TruthMessage(const LowLevel::Truth& truth, TimeNs offset_ns) {
  message_.stamp_ns_ = truth.t_ns - offset_ns;
  message_.base_pose_ = to_message(truth.base_pose);
  message_.spawn_pose_ = to_message(truth.spawn_pose);
  message_.contact_count_ = truth.contact_count;
  message_.clearance_ = truth.clearance;
  message_.frames_dropped_ = truth.frames_dropped;
  std::size_t n = 0;
  for (const LowLevel::Truth::Object& in : truth.objects) {
    if (n == objects_.size()) break;
    const wb_sim_object& o = in.object;
    msg::TruthObject& out = objects_[n++];
    copy_text(out.name_, o.name);
    out.is_revolute_ = o.is_revolute != 0;
    out.value_ = o.value;
    out.velocity_ = o.velocity;
    out.range_ = o.range;
    out.X_SG_ = to_message(o.X_SG);
    out.handle_radius_ = o.handle_radius;
    out.handle_length_ = o.handle_length;
    std::copy_n(o.axis_origin, 3, out.axis_origin_);
    std::copy_n(o.axis, 3, out.axis_);
    out.carcass_ = to_message(o.carcass);
    out.moving_ = to_message(o.moving);
    out.X_GE_ = to_message(in.X_GE);
    out.clearance_ = in.clearance;
  }
  view(message_.objects_, objects_, n);
  n = 0;
  for (const wb_sim_contact& in : truth.contacts) {
    if (n == contacts_.size()) break;
    msg::TruthContact& out = contacts_[n++];
    out.t_ns_ = in.t_ns - offset_ns;
    copy_text(out.robot_geom_, in.robot_geom);
    copy_text(out.other_geom_, in.other_geom);
    copy_text(out.object_, in.object);
  }
  view(message_.contacts_, contacts_, n);
  n = 0;
  for (const auto& [name, X] : truth.links) {
    if (n == links_.size()) break;
    copy_text(links_[n].name_, name);
    links_[n++].X_SL_ = to_message(X);
  }
  view(message_.links_, links_, n);
}

}  // namespace wb::dds
