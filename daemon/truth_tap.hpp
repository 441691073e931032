// Carries the simulator's truth from the thread that advances the plant to the oracle in the
// perception job and, with --truth, to the service. Only wiring knows all of them. Each function
// names its thread. Frame S: the simulated world.
#pragma once
#include <array>
#include <set>
#include <string>

#include "core/rt/latest.hpp"
#include "daemon/service/service_snapshot.hpp"
#include "drivers/driver_host.hpp"
#include "drivers/sim/truth.h"
#include "perception/oracle_interpreter.hpp"

namespace wb {

Eigen::Isometry3d isometry(const wb_sim_pose& pose);
wb_sim_pose sim_pose(const Eigen::Isometry3d& X);

class TruthTap {
 public:
  // Throws std::runtime_error if no driver knows the truth.
  TruthTap(const DriverHost& host, std::string shoulder_camera);

  void sample(TimeNs t) RT_SAFE;  // the thread that advances; measures every kPeriod_ns
  bool find(const Name& object, ObjectTruth& truth);  // the perception job; newest sample
  void show(ServiceSnapshot& snapshot);               // the service's thread; newest sample
  // The thread that advances: what stands open and what was touched, such as "drawer_1 at 0.441 of
  // 0.450 m, 0 collisions".
  std::string summary() const;
  std::set<std::string> object_names() const;
  Eigen::Isometry3d spawn_pose() const { return isometry(truth_->spawn_pose(driver_)); }

 private:
  static constexpr TimeNs kPeriod_ns = 10'000'000;
  static constexpr int kMaxObjects = ServiceSnapshot::kMaxTruth;
  struct Sample {
    std::uint64_t seq = 0;
    int count = 0;
    std::array<Name, kMaxObjects> names{};
    std::array<ObjectTruth, kMaxObjects> objects{};
    int contact_count = 0;
    std::array<TruthContact, ServiceSnapshot::kMaxTruth> contacts{};
  };
  wb_driver* driver_ = nullptr;  // before truth_: looking that up fills it
  const wb_sim_truth* truth_;
  std::string shoulder_camera_;
  TimeNs next_ = 0;
  Latest<Sample, 2> samples_;  // readers: perception, service
};

}  // namespace wb
