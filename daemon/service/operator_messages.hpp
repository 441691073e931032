// What operators and the daemon say to each other, as plain C++ values: the DDS edge converts them
// to wholebody_msgs. World: jobs (ordinary threads). Stamps here are ROS time in nanoseconds
// (CLOCK_REALTIME), not the daemon's clock.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/types/request.hpp"

namespace wb {

struct OperatorCommand {
  std::uint64_t request_id = 0;  // used once by a client
  std::string client;
  std::int64_t stamp_ns = 0;
  std::string verb;            // open, stop, reset, move_joints, move_base, tune, revert
  std::string object;          // open; tune, revert: the weight (revert: empty for all)
  double opened_fraction = 0;  // open: of the joint's range; 0 = the object's default
  std::vector<double> values;  // move_joints: rad or m; move_base: x, y [m], yaw [rad] in W;
                               // tune: the value
};

struct OperatorAck {
  std::uint64_t request_id = 0;
  std::string client;
  std::int64_t stamp_ns = 0;
  std::string outcome;     // one of to_string(RequestOutcome)
  std::string phase;       // one of to_string(Phase)
  std::string reason;      // why refused or failed, empty otherwise
  double joint_value = 0;  // of the object, rad or m
  double joint_range = 0;

  bool final() const { return outcome != "accepted" && outcome != "running"; }
};

struct DaemonStatus {
  struct Loop {
    std::string name;
    std::uint64_t cycles = 0, overruns = 0;
    double p50_us = 0, p99_us = 0, max_us = 0;
  };
  struct Counter {
    std::string name;
    std::uint64_t count = 0;
  };
  std::int64_t stamp_ns = 0;
  std::string mode, phase;
  std::string object, outcome, reason;  // of the newest request, or empty
  double joint_value = 0, joint_range = 0;
  std::array<double, 3> base{};  // x, y [m], yaw [rad] in W
  double gripper_opening_m = 0;
  std::vector<Loop> loops;
  std::vector<Counter> counters;
  std::string mpc_trouble;
};

// What the newest solve did, and which terms compete (mpc/explanation.hpp).
struct DaemonExplanation {
  struct Term {
    std::string name;
    double cost = 0, share = 0, violation = 0, pull = 0;
  };
  struct Competition {
    std::string first, second;
    double cosine = 0;
    std::string text;
  };
  std::int64_t stamp_ns = 0;  // of the state that was solved from
  std::string status, trouble;
  double step = 0, cpu_ms = 0, cost = 0;
  std::uint64_t weights_revision = 0;
  std::vector<Term> terms;
  std::vector<Competition> competing;
};

struct DaemonTuning {
  struct Weight {
    std::string name;
    double value = 0, configured = 0, low = 0, high = 0;
  };
  std::uint64_t revision = 0;
  std::vector<Weight> weights;
};

std::string_view to_string(RequestOutcome outcome);

// The reason in the refusal of a command whose (client, request_id) was used before.
inline constexpr std::string_view kDuplicateReason = "request id was used before";

// ROS time now.
std::int64_t ros_now_ns();

// ROS_DOMAIN_ID, or 0 if it is not set. Throws config::ConfigError unless it is an integer in 0 ..
// 232.
int domain_from_environment();

}  // namespace wb
