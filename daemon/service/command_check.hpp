// Decides whether an operator's command is well-formed, before anything of the controller sees it.
// Pure: no state, no clock. World: jobs (the service's thread). What the present mode allows is the
// sequencer's decision, not this one's.
#pragma once
#include <set>
#include <string>
#include <vector>

#include "core/model/robot_model.hpp"
#include "core/types/request.hpp"
#include "daemon/service/operator_messages.hpp"
#include "mpc/weight_table.hpp"

namespace wb {

enum class Refusal : std::uint8_t {
  kNone,
  kNoClient,  // nobody to answer to
  kUnknownVerb,
  kUnknownObject,  // empty, or not in the list
  kUnknownWeight,  // or one that cannot be tuned
  kNotFinite,      // a NaN or infinity anywhere
  kOutOfRange,
  kWrongCount,  // of values, for this verb and robot
  kStale,       // stamp too old, or from the future
  kDuplicate,   // (client, request_id) was used before
  kBusy,        // the controller's queue is full
};
inline constexpr int kRefusalKinds = 11;
std::string_view to_string(Refusal refusal);

struct CommandRules {
  std::set<std::string> objects;    // known names, each shorter than kMaxNameLength
  std::vector<JointLimits> joints;  // of the robot's q
  std::vector<WeightInfo> weights;  // by index in Weights
  std::set<std::string> terms;      // of the MPC; those without a weight above cannot be tuned
  bool mobile_base = true;
  double base_reach_m = 50.0;  // |x|, |y| of a base goal
  TimeNs age_max_ns = 2 * kNanosPerSecond;
  TimeNs future_max_ns = 5'000'000;  // DESIGN.md, "Time"
};

struct CheckedCommand {
  Refusal refusal = Refusal::kNone;
  std::string reason;  // for the operator, empty if accepted
  Request request;     // without id and t_ns; kNone if refused
};

// `now_ros_ns` is ROS time. A stop is never stale: it is safe whenever it comes, and a wrong clock
// must not disable it.
CheckedCommand check_command(const OperatorCommand& command, const CommandRules& rules,
                             std::int64_t now_ros_ns);

}  // namespace wb
