// The physics: MuJoCo's model and state of robot and scene, with servos, sensors and the log of
// contacts around it. Constructor: setup world. step(): step world. After every step positions,
// velocities, contacts and bias forces belong to the present state. Time is the plant's own, from
// 0. Frame S: the simulated world.
#pragma once
#include <Eigen/Geometry>

#include "drivers/sim/clearance.hpp"
#include "drivers/sim/contacts.hpp"
#include "drivers/sim/mjcf.hpp"
#include "drivers/sim/rollers.hpp"
#include "drivers/sim/sensors.hpp"
#include "drivers/sim/servos.hpp"

namespace wb::sim {

class Plant {
 public:
  explicit Plant(const PluginConfig& config);

  void step() noexcept;
  TimeNs step_ns() const noexcept { return step_ns_; }
  TimeNs time_ns() const noexcept { return time_ns_; }
  // False once MuJoCo reported a state that it could not go on from.
  bool healthy() const noexcept;

  const mjModel& model() const noexcept { return *model_; }
  const mjData& data() const noexcept { return *data_; }
  Servos& servos() noexcept { return *servos_; }
  const Servos& servos() const noexcept { return *servos_; }
  const wb_readings& readings() const noexcept { return sensors_->newest(); }
  const ContactLog& contacts() const noexcept { return *contacts_; }
  Clearance& clearance() noexcept { return *clearance_; }

  // -1 where there is no such link, unit or part.
  int body(const std::string& name) const noexcept {
    return mj_name2id(model_.get(), mjOBJ_BODY, name.c_str());
  }
  Eigen::Isometry3d X_S(int body) const noexcept;
  const Eigen::Isometry3d& spawn_pose() const noexcept { return X_SB0_; }  // on the floor

  // For tests: puts a part's joint, at rest, and keeps a force and torque (in S) on a body until
  // told otherwise.
  void set_part(int joint, double value) noexcept;
  void push(int body, const double force[3], const double torque[3]) noexcept;

 private:
  void place(const PluginConfig& config);
  void settle();

  ModelPtr model_;
  DataPtr data_;
  TimeNs step_ns_ = 0;
  TimeNs time_ns_ = 0;
  std::unique_ptr<Servos> servos_;
  std::unique_ptr<Rollers> rollers_;
  std::unique_ptr<Sensors> sensors_;
  std::unique_ptr<ContactLog> contacts_;
  std::unique_ptr<Clearance> clearance_;
  int base_body_ = 0;
  Eigen::Isometry3d X_SB0_ = Eigen::Isometry3d::Identity();
};

}  // namespace wb::sim
