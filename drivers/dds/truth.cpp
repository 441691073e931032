#include "drivers/dds/truth.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "drivers/dds/instance.hpp"

namespace wb::dds {
namespace {

wb_sim_pose pose(const msg::TruthPose& in) {
  wb_sim_pose out;
  std::copy_n(in.p_, 3, out.p);
  std::copy_n(in.q_, 4, out.q);
  return out;
}

wb_sim_box box(const msg::TruthBox& in) {
  wb_sim_box out;
  out.X_SM = pose(in.X_SM_);
  std::copy_n(in.half_extent_, 3, out.half_extent);
  return out;
}

bool finite(const wb_sim_pose& X) {
  double sum = 0;
  for (const double v : X.p) sum += v;
  for (const double v : X.q) sum += v;
  return std::isfinite(sum);
}

bool finite(const wb_sim_object& o) {
  double sum = o.value + o.velocity + o.range + o.handle_radius + o.handle_length;
  for (int i = 0; i < 3; ++i)
    sum += o.axis_origin[i] + o.axis[i] + o.carcass.half_extent[i] + o.moving.half_extent[i];
  return std::isfinite(sum) && finite(o.X_SG) && finite(o.carcass.X_SM) && finite(o.moving.X_SM);
}

}  // namespace

Fault TruthStore::store(const msg::Truth& in) {
  if (in.boot_ != boot_) return Fault::kWrongSource;
  if (in.sequence_ == sequence_) return Fault::kDuplicate;
  if (in.sequence_ < sequence_) return Fault::kOutOfOrder;
  TruthSample& s = samples_.writing();
  s.stamp_ns = in.stamp_ns_;
  s.base_pose = pose(in.base_pose_);
  s.spawn_pose = pose(in.spawn_pose_);
  s.clearance = in.clearance_;
  s.frames_dropped = in.frames_dropped_;
  s.object_count = std::min<std::uint32_t>(in.objects_._length, TruthSample::kObjects);
  for (std::uint32_t i = 0; i < s.object_count; ++i) {
    const msg::TruthObject& from = in.objects_._buffer[i];
    wb_sim_object& o = s.objects[i].object;
    copy_text(o.name, from.name_);
    o.is_revolute = from.is_revolute_;
    o.value = from.value_;
    o.velocity = from.velocity_;
    o.range = from.range_;
    o.X_SG = pose(from.X_SG_);
    o.handle_radius = from.handle_radius_;
    o.handle_length = from.handle_length_;
    std::copy_n(from.axis_origin_, 3, o.axis_origin);
    std::copy_n(from.axis_, 3, o.axis);
    o.carcass = box(from.carcass_);
    o.moving = box(from.moving_);
    s.objects[i].X_GE = pose(from.X_GE_);
    s.objects[i].clearance = from.clearance_;
    if (!finite(o)) return Fault::kNonFinite;
  }
  if (!finite(s.base_pose) || !finite(s.spawn_pose)) return Fault::kNonFinite;
  s.contact_count = in.contact_count_;
  const auto name = [&](const char* text) { return names_.insert(text).first->c_str(); };
  std::uint32_t told = std::min<std::uint32_t>(in.contacts_._length, TruthSample::kContacts);
  for (std::uint32_t i = 0; i < told; ++i) {
    const msg::TruthContact& from = in.contacts_._buffer[i];
    s.contacts[i] = {from.t_ns_, name(from.robot_geom_), name(from.other_geom_),
                     name(from.object_)};
  }
  for (std::size_t i = told; i < TruthSample::kContacts; ++i) s.contacts[i].robot_geom = nullptr;
  s.link_count = std::min<std::uint32_t>(in.links_._length, TruthSample::kLinks);
  for (std::uint32_t i = 0; i < s.link_count; ++i) {
    copy_text(s.links[i].name, in.links_._buffer[i].name_);
    s.links[i].X_SL = pose(in.links_._buffer[i].X_SL_);
    if (!finite(s.links[i].X_SL)) return Fault::kNonFinite;
  }
  sequence_ = in.sequence_;
  samples_.publish();
  return Fault::kNone;
}

const TruthSample& TruthStore::newest() {
  const TruthSample* s = samples_.read();
  return s ? *s : none_;
}

namespace {

// The table's functions take a const driver; pinning the newest sample changes the reader's side of
// the buffer only.
const TruthSample& newest(const wb_driver* driver) {
  return const_cast<wb_driver*>(driver)->link.truth().newest();
}

std::int64_t time_ns(const wb_driver* driver) {
  return newest(driver).stamp_ns - driver->exchange.stamp_offset();
}
wb_sim_pose base_pose(const wb_driver* driver) { return newest(driver).base_pose; }
wb_sim_pose spawn_pose(const wb_driver* driver) { return newest(driver).spawn_pose; }
std::uint32_t object_count(const wb_driver* driver) { return newest(driver).object_count; }

wb_status object(const wb_driver* driver, std::uint32_t index, wb_sim_object* out) {
  const TruthSample& s = newest(driver);
  if (index >= s.object_count) return WB_ERROR;
  *out = s.objects[index].object;
  return WB_OK;
}

std::uint32_t contact_count(const wb_driver* driver) { return newest(driver).contact_count; }

wb_status contact(const wb_driver* driver, std::uint32_t index, wb_sim_contact* out) {
  const TruthSample& s = newest(driver);
  if (index >= TruthSample::kContacts || s.contacts[index].robot_geom == nullptr) return WB_ERROR;
  *out = s.contacts[index];
  out->t_ns -= driver->exchange.stamp_offset();
  return WB_OK;
}

double clearance(wb_driver* driver, const char* target) {
  const TruthSample& s = newest(driver);
  if (target == nullptr) return s.clearance;
  for (std::uint32_t i = 0; i < s.object_count; ++i) {
    if (std::strcmp(s.objects[i].object.name, target) == 0) return s.objects[i].clearance;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

wb_status link_pose(const wb_driver* driver, const char* link, wb_sim_pose* out) {
  const TruthSample& s = newest(driver);
  for (std::uint32_t i = 0; i < s.link_count; ++i) {
    if (std::strcmp(s.links[i].name, link) != 0) continue;
    *out = s.links[i].X_SL;
    return WB_OK;
  }
  return WB_ERROR;
}

wb_status hand_in_handle(const wb_driver* driver, std::uint32_t index, wb_sim_pose* out) {
  const TruthSample& s = newest(driver);
  if (index >= s.object_count) return WB_ERROR;
  *out = s.objects[index].X_GE;
  return WB_OK;
}

std::uint64_t frames_dropped(const wb_driver* driver) { return newest(driver).frames_dropped; }

}  // namespace

const wb_sim_truth* truth_table() {
  static const wb_sim_truth table = {time_ns,   base_pose,      spawn_pose,    object_count,
                                     object,    contact_count,  contact,       clearance,
                                     link_pose, hand_in_handle, frames_dropped};
  return &table;
}

}  // namespace wb::dds
