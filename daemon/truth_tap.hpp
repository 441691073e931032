// Carries the simulator's truth from the thread that advances the plant to the oracle in the perception job. Only wiring knows both.
// sample(): the thread that advances. find(): the perception job. Frame S: the simulated world.
#pragma once
#include <array>
#include <set>
#include <string>

#include "core/rt/latest.hpp"
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

  void sample(TimeNs t) RT_SAFE;                       // every kPeriod_ns
  bool find(const Name& object, ObjectTruth& truth);   // newest sample
  std::set<std::string> object_names() const;
  Eigen::Isometry3d spawn_pose() const { return isometry(truth_->spawn_pose(driver_)); }

 private:
  static constexpr TimeNs kPeriod_ns = 10'000'000;
  static constexpr int kMaxObjects = 16;
  struct Sample {
    std::uint64_t seq = 0;
    int count = 0;
    std::array<Name, kMaxObjects> names{};
    std::array<ObjectTruth, kMaxObjects> objects{};
  };
  wb_driver* driver_ = nullptr;   // before truth_: looking that up fills it
  const wb_sim_truth* truth_;
  std::string shoulder_camera_;
  TimeNs next_ = 0;
  Latest<Sample> samples_;
};

}  // namespace wb
