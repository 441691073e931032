// What sampling the arm's postures tells: which capsules can meet, where the arm is stowed, how it
// is ready. Setup world; seeded, deterministic. The arm is a chain: body i hangs on body i - 1.
// Frame B, SI.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/model/import/inverse_kinematics.hpp"

namespace wb {

// What the MPC keeps between a pair, and from where on it feels the pair.
inline constexpr double kPairDistance_m = 0.05, kPairReach_m = 0.03;
// What it keeps between a joint and its limit, and from where on it feels the limit [rad or m].
inline constexpr double kLimitDistance = 0.03;
double limit_reach(const RobotModel& model);  // 0.2, at most a quarter of the smallest range

struct SamplingOptions {
  int samples = 20000;  // postures; pairs use a fifth of them
  std::uint64_t seed = 1;
};

struct PairSample {
  std::array<int, 2> pair{};      // indices into the model's capsules
  double near = 0, touching = 0;  // share of the postures closer than kPairDistance_m, than 0
  double least_m = 0;
  enum class Verdict { kKept, kApart, kAlwaysNear } verdict{};
};

// Every pair of capsules whose bodies are not the same or neighbours. Apart: in no posture closer
// than kPairDistance_m, or in more than a twentieth of them but never touching. Always near: closer
// in more than `always` of them, so that shape and not posture decides.
std::vector<PairSample> sample_pairs(const RobotModel& model, const SamplingOptions& options,
                                     double always = 0.75);

struct Postures {
  std::vector<double> stowed, ready;
  double stowed_radius_m = 0;                          // of the circle about B that holds the robot
  double stowed_distance_m = 0, ready_distance_m = 0;  // smallest of the pairs
  double ready_singular_value = 0;
  double ready_angle_rad = 0;  // between the hand's z and straight forward
  Eigen::Vector3d p_BE_ready{0, 0, 0};
  bool path_free = false;  // the straight line between the two keeps the pairs apart
  bool collision_free = false;
};

// Out of the reach of the MPC's self-collision (and, ready, of the joints' limits) if such postures
// are found: it would hold the arm beside them. The model holds capsules, pairs and spheres.
// `base_front_m`: how far the base reaches forward.
Postures find_postures(const RobotModel& model, double base_front_m,
                       const SamplingOptions& options);

// Longest distance that the arm's joints span [m].
double arm_reach(const RobotModel& model);
// Smallest pair distance on the straight line between postures.
double path_distance(const RobotModel& model, const std::vector<double>& from,
                     const std::vector<double>& to);
double radius_about_base(const RobotModel& model, const std::vector<double>& q);

}  // namespace wb
