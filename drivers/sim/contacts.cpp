#include "drivers/sim/contacts.hpp"

#include <string_view>

#include "drivers/sim/mjcf.hpp"

namespace wb::sim {

ContactLog::ContactLog(const PluginConfig& config, const mjModel& model)
    : kinds_(model.ngeom), seen_(static_cast<std::size_t>(model.ngeom) * model.ngeom) {
  touches_.reserve(kMaxTouches);
  const int root = mj_name2id(&model, mjOBJ_BODY, config.robot.base.link.c_str());
  for (int geom = 0; geom < model.ngeom; ++geom) {
    const int body = model.geom_bodyid[geom];
    if (body > 0 && model.body_rootid[body] == root) {
      kinds_[geom] = model.geom_contype[geom] == 0 ? kRobot | kRolling : kRobot;
      const int joint = model.body_jntadr[body];
      for (const std::string& finger : config.robot.fingers) {
        if (joint >= 0 && finger == mj_id2name(&model, mjOBJ_JOINT, joint)) kinds_[geom] |= kFinger;
      }
    }
  }
  kinds_[mj_name2id(&model, mjOBJ_GEOM, kFloorGeom)] = kFloor;
  for (const Unit& unit : config.scene.units) {
    for (const Part& part : unit.parts) {
      for (const Solid& solid : part.solids) {
        if (solid.handle) kinds_[mj_name2id(&model, mjOBJ_GEOM, solid.name.c_str())] = kHandle;
      }
    }
  }
}

bool ContactLog::expected(unsigned a, unsigned b) const noexcept {
  return ((a & kFinger) && (b & kHandle)) || ((a & kRolling) && (b & kFloor));
}

void ContactLog::scan(const mjData& data, TimeNs t_ns) noexcept {
  for (int i = 0; i < data.ncon; ++i) {
    int a = data.contact[i].geom1, b = data.contact[i].geom2;
    if (!is_robot(a)) std::swap(a, b);
    if (!is_robot(a) || expected(kinds_[a], kinds_[b]) || expected(kinds_[b], kinds_[a])) continue;
    if (is_robot(b) && b < a) std::swap(a, b);
    const std::size_t pair = static_cast<std::size_t>(a) * kinds_.size() + b;
    if (seen_[pair] || touches_.size() == kMaxTouches) continue;
    seen_[pair] = true;
    touches_.push_back({t_ns, a, b});
  }
}

}  // namespace wb::sim
