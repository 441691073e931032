// Watches a simulated run from outside, with the simulator's truth: how far the object opened,
// contacts, clearance, slip, path. For benches and the demo; Lockstep only (the thread that
// advances the plant). Frame S: the simulated world.
#pragma once
#include <cstdio>
#include <filesystem>
#include <string>

#include "daemon/system.hpp"

namespace wb {

struct RunResult {
  bool opened = false;                 // reached the threshold
  double time_s = 0;                   // from the accepted command to the threshold
  double opened_value = 0, range = 0;  // at the end, m or rad
  bool revolute = false;               // rad
  double opened_fraction = 0;          // largest so far, of the range
  double ee_path_m = 0;
  double min_clearance_m = 1e9;
  int collisions = 0;
  std::string first_collision;
  double slip_m = 0;  // largest displacement of hand against handle since the grasp
};

class RunObserver {
 public:
  // Throws std::runtime_error if there is no such object.
  RunObserver(System& system, const std::string& object, double threshold_fraction);
  ~RunObserver();

  void start(TimeNs t) { start_ = t; }  // the command was accepted
  void sample(TimeNs t);  // call after each instant; measures every 10 ms, clearance every 100 ms
  const RunResult& result() const { return result_; }

  // Also writes folder/run.csv and pictures at start, grasp (and the hand close up) and end.
  void write_to(const std::filesystem::path& folder);
  // folder/name.ppm: by the scene's view camera, or by one at X_SC (optical frame).
  void picture(const std::string& name, const Eigen::Isometry3d* X_SC = nullptr) const;
  void finish();  // last picture; closes the csv

  // 65 % drawers, 60 % ovens, 75 % washing machines, 65 % others (Mittal et al. 2022, Sec. V).
  static double threshold(const std::string& object);

 private:
  System& system_;
  wb_driver* driver_ = nullptr;  // before truth_: looking that up fills it
  const wb_sim_truth* truth_;
  const wb_sim_view* view_;
  std::string object_;
  std::uint32_t index_ = 0;
  double threshold_;
  TimeNs start_ = 0, next_ = 0, next_clearance_ = 0;
  bool have_hand_ = false, grasped_ = false;
  Eigen::Vector3d last_hand_{0, 0, 0};
  Eigen::Isometry3d X_GE_grasp_ = Eigen::Isometry3d::Identity();
  double clearance_ = 0;
  RunResult result_;
  std::filesystem::path folder_;
  std::FILE* csv_ = nullptr;
};

}  // namespace wb
