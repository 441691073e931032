// Everything that the service shows of the controller, newest value wins (a
// Latest<ServiceSnapshot>). Trivially copyable. Filled by the daemon's wiring, read by the
// service's thread. Frames: W odometry, E hand. Times: the daemon's clock.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/name.hpp"
#include "core/types/pose.hpp"
#include "core/types/request.hpp"
#include "core/types/robot_state.hpp"
#include "core/types/weights.hpp"

namespace wb {

struct LoopStatistics {
  Name name;
  std::uint64_t cycles = 0;
  std::uint64_t overruns = 0;  // steps that took longer than their period
  double p50_us = 0, p99_us = 0, max_us = 0;
};

struct NamedCount {
  Name name;
  std::uint64_t count = 0;
};

// The simulator's ground truth, shown only with --truth; no controller sees it.
struct TruthJoint {
  Name object;
  double value = 0;  // rad or m
};
struct TruthContact {
  Name body_a, body_b;
};

struct ServiceSnapshot {
  static constexpr int kMaxLoops = 8;
  static constexpr int kMaxDriverCounters = 96;
  static constexpr int kMaxCounters = 32 + kMaxDriverCounters;
  static constexpr int kMaxTruth = 16;

  std::uint64_t seq = 0;
  RobotState state;
  Name object;            // what the newest request is about, or empty
  RequestStatus request;  // newest; id 0: there was none

  int plan_count = 0;  // the policy's hand poses X_WE over the horizon
  std::array<TimeNs, kMaxNodes> plan_t_ns{};
  std::array<Pose, kMaxNodes> plan{};

  int loop_count = 0;
  std::array<LoopStatistics, kMaxLoops> loops{};
  int counter_count = 0;
  std::array<NamedCount, kMaxCounters> counters{};

  Weights weights;                      // in force; count 0: as configured
  std::array<char, 128> mpc_trouble{};  // newest, as text

  int truth_joint_count = 0;
  std::array<TruthJoint, kMaxTruth> truth_joints{};
  int truth_contact_count = 0;
  std::array<TruthContact, kMaxTruth> truth_contacts{};
};

}  // namespace wb
