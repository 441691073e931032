// The tables of truth.h.
#include <cmath>
#include <cstring>
#include <limits>

#include "drivers/sim/instance.hpp"
#include "drivers/sim/truth.h"

namespace wb::sim {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

wb_sim_pose to_c(const Isometry3d& X) {
  const Eigen::Quaterniond q(X.linear());
  wb_sim_pose out;
  Eigen::Map<Vector3d>(out.p) = X.translation();
  Eigen::Map<Eigen::Vector4d>(out.q) = q.normalized().coeffs();
  return out;
}

Isometry3d from_c(const wb_sim_pose& pose) {
  Isometry3d X = Isometry3d::Identity();
  X.linear() = Eigen::Quaterniond(pose.q[3], pose.q[0], pose.q[1], pose.q[2])
                   .normalized()
                   .toRotationMatrix();
  X.translation() = Eigen::Map<const Vector3d>(pose.p);
  return X;
}

// The box about solids of a body, in the body's axes.
wb_sim_box bounding_box(const std::vector<Solid>& solids, const Isometry3d& X_SB) {
  Eigen::AlignedBox3d box;
  for (const Solid& solid : solids) {
    const Vector3d reach = solid.X_body.linear().cwiseAbs() * solid.extent();
    box.extend(solid.X_body.translation() - reach);
    box.extend(solid.X_body.translation() + reach);
  }
  wb_sim_box out;
  out.X_SM = to_c(X_SB * Eigen::Translation3d(box.center()));
  Eigen::Map<Vector3d>(out.half_extent) = 0.5 * box.sizes();
  return out;
}

std::int64_t time_ns(const wb_driver* driver) { return driver->now_ns(); }
wb_sim_pose base_pose(const wb_driver* driver) {
  return to_c(driver->plant.X_S(driver->plant.body(driver->config.robot.base.link)));
}
wb_sim_pose spawn_pose(const wb_driver* driver) { return to_c(driver->plant.spawn_pose()); }
std::uint32_t object_count(const wb_driver* driver) {
  return static_cast<std::uint32_t>(driver->objects.size());
}

wb_status object(const wb_driver* driver, std::uint32_t index, wb_sim_object* out) {
  if (index >= driver->objects.size()) return WB_ERROR;
  const Object& o = driver->objects[index];
  const mjModel& model = driver->plant.model();
  const mjData& data = driver->plant.data();
  const Isometry3d X_SB = driver->plant.X_S(o.body);
  *out = {};
  std::strncpy(out->name, o.part->name.c_str(), sizeof(out->name) - 1);
  out->is_revolute = o.part->joint.revolute;
  out->value = data.qpos[model.jnt_qposadr[o.joint]];
  out->velocity = data.qvel[model.jnt_dofadr[o.joint]];
  out->range = o.part->joint.range;
  out->X_SG = to_c(X_SB * o.part->handle.X_body);
  out->handle_radius = o.part->handle.radius_m;
  out->handle_length = o.part->handle.length_m;
  Eigen::Map<Vector3d>(out->axis_origin) = X_SB.translation();
  Eigen::Map<Vector3d>(out->axis) = X_SB.linear() * o.part->joint.axis;
  out->carcass = bounding_box(o.unit->solids, driver->plant.X_S(o.unit_body));
  out->moving = bounding_box(o.part->solids, X_SB);
  return WB_OK;
}

std::uint32_t contact_count(const wb_driver* driver) {
  return static_cast<std::uint32_t>(driver->plant.contacts().touches().size());
}

wb_status contact(const wb_driver* driver, std::uint32_t index, wb_sim_contact* out) {
  if (index >= contact_count(driver)) return WB_ERROR;
  const mjModel& model = driver->plant.model();
  const Touch& touch = driver->plant.contacts().touches()[index];
  const int body = model.geom_bodyid[touch.other_geom];
  const bool of_scene = body != 0 && !driver->plant.contacts().is_robot(touch.other_geom);
  out->t_ns = touch.t_ns + driver->offset_ns;
  out->robot_geom = mj_id2name(&model, mjOBJ_GEOM, touch.robot_geom);
  out->other_geom = mj_id2name(&model, mjOBJ_GEOM, touch.other_geom);
  out->object = of_scene ? mj_id2name(&model, mjOBJ_BODY, body) : "";
  return WB_OK;
}

double clearance(wb_driver* driver, const char* target) {
  const mjModel& model = driver->plant.model();
  std::vector<bool> skipped(model.ngeom);
  if (target != nullptr) {
    bool known = false;
    for (const Object& o : driver->objects) {
      if (o.part->name != target) continue;
      known = true;
      for (int geom = 0; geom < model.ngeom; ++geom) {
        skipped[geom] = model.geom_bodyid[geom] == o.body || model.geom_bodyid[geom] == o.unit_body;
      }
    }
    if (!known) return std::numeric_limits<double>::quiet_NaN();
  }
  return driver->plant.clearance().robot_to_scene(driver->plant.data(), skipped);
}

wb_status link_pose(const wb_driver* driver, const char* link, wb_sim_pose* out) {
  const int body = driver->plant.body(link);
  if (body < 0) return WB_ERROR;
  *out = to_c(driver->plant.X_S(body));
  return WB_OK;
}

wb_status hand_in_handle(const wb_driver* driver, std::uint32_t index, wb_sim_pose* out) {
  if (index >= driver->objects.size()) return WB_ERROR;
  const Object& o = driver->objects[index];
  const Isometry3d X_SG = driver->plant.X_S(o.body) * o.part->handle.X_body;
  *out = to_c(X_SG.inverse(Eigen::Isometry) *
              driver->plant.X_S(driver->plant.body(driver->config.robot.end_effector)));
  return WB_OK;
}

wb_status render(wb_driver* driver, std::uint32_t width, std::uint32_t height,
                 const wb_sim_pose* X_SC, double width_rad, std::uint8_t* rgb) {
  if (width == 0 || height == 0 || width > 1920 || height > 1200 || rgb == nullptr) return WB_ERROR;
  const Scene& scene = driver->config.scene;
  const mjModel& model = driver->plant.model();
  Isometry3d X = Isometry3d::Identity();
  if (X_SC != nullptr) {
    X = from_c(*X_SC);
  } else {
    const Vector3d ahead = (scene.view.target - scene.view.position).normalized();
    const Vector3d right = ahead.cross(Vector3d::UnitZ()).normalized();
    X.linear() << right, ahead.cross(right), ahead;
    X.translation() = scene.view.position;
  }
  const double f = 0.5 * width / std::tan(0.5 * (width_rad > 0 ? width_rad : scene.view.width_rad));
  const CameraIntrinsics camera{
      static_cast<int>(width), static_cast<int>(height), f, f, 0.5 * width, 0.5 * height, 0, 1e3};
  GeomPoses poses(model);
  poses.take(driver->plant.data(), driver->now_ns());
  const Painter painter(model, scene.light);
  const CameraIntrinsics lamp = Painter::shadow_camera();
  RayCaster shadows(model, lamp.width, lamp.height);
  shadows.render(poses, painter.shadow_pose(), lamp);
  RayCaster caster(model, camera.width, camera.height);
  caster.render(poses, X, camera);
  painter.paint(caster, poses, X, camera, rgb, &shadows);
  return WB_OK;
}

wb_status stop_answering(wb_driver* driver, std::uint32_t on) {
  driver->faults.silent = on != 0;
  return WB_OK;
}

wb_status freeze(wb_driver* driver, std::uint32_t on) {
  driver->faults.frozen = on != 0;
  driver->frozen = driver->plant.readings();
  driver->frozen.t_ns += driver->offset_ns;
  return WB_OK;
}

wb_status emergency_stop(wb_driver* driver, std::uint32_t pressed) {
  driver->faults.emergency_stop = pressed != 0;
  return WB_OK;
}

wb_status set_object(wb_driver* driver, std::uint32_t index, double value) {
  if (index >= driver->objects.size()) return WB_ERROR;
  driver->plant.set_part(driver->objects[index].joint, value);
  return WB_OK;
}

wb_status push(wb_driver* driver, const char* link, const double force[3], const double torque[3]) {
  const int body = driver->plant.body(link);
  if (body < 0) return WB_ERROR;
  driver->plant.push(body, force, torque);
  return WB_OK;
}

std::uint64_t frames_dropped(const wb_driver* driver) { return driver->cameras.dropped(); }

constexpr wb_sim_truth kTruth = {time_ns,   base_pose,      spawn_pose,    object_count,
                                 object,    contact_count,  contact,       clearance,
                                 link_pose, hand_in_handle, frames_dropped};
constexpr wb_sim_view kView = {render};
constexpr wb_sim_fault kFault = {stop_answering, freeze, emergency_stop, set_object, push};

}  // namespace

const void* find_extension(const char* name) {
  if (std::strcmp(name, WB_SIM_TRUTH) == 0) return &kTruth;
  if (std::strcmp(name, WB_SIM_VIEW) == 0) return &kView;
  if (std::strcmp(name, WB_SIM_FAULT) == 0) return &kFault;
  return nullptr;
}

}  // namespace wb::sim

wb_driver::wb_driver(wb::sim::PluginConfig c)
    : config(std::move(c)), plant(config), cameras(config, plant) {
  for (const wb::sim::Unit& unit : config.scene.units) {
    for (const wb::sim::Part& part : unit.parts) {
      objects.push_back({&unit, &part, mj_name2id(&plant.model(), mjOBJ_JOINT, part.name.c_str()),
                         plant.body(part.name), plant.body(unit.name)});
    }
  }
}
