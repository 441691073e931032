// Operator requests, checked by the service before they are queued, and their acknowledgement.
#pragma once
#include <array>
#include <cstdint>
#include <string_view>

#include "core/types/mode.hpp"
#include "core/types/name.hpp"
#include "core/types/time.hpp"

namespace wb {

enum class RequestKind : std::uint8_t {
  kNone,
  kOpen,
  kStop,
  kReset,
  kMoveJoints,
  kMoveBase,
  kTune,    // sets a weight of the MPC; this and kRevert go to the MPC loop, the others to control
  kRevert,  // a weight, or all, as configured
};
constexpr bool tunes(RequestKind kind) {
  return kind == RequestKind::kTune || kind == RequestKind::kRevert;
}

struct Request {
  std::uint64_t id = 0;
  RequestKind kind = RequestKind::kNone;
  TimeNs t_ns = 0;             // when it entered the daemon
  Name object;                 // kOpen
  double opened_fraction = 0;  // kOpen: how far, of the joint's range; 0 = the object's default
  int joint_count = 0;         // kMoveJoints
  std::array<double, kMaxJoints> q{};  // kMoveJoints: rad or m
  std::array<double, 3> base{};        // kMoveBase: x, y [m], yaw [rad] in W
  int weight = -1;                     // kTune, kRevert: index in Weights; kRevert: -1 for all
  double value = 0;                    // kTune
};

// What became of a request; travels control -> service.
enum class RequestOutcome : std::uint8_t { kAccepted, kRefused, kRunning, kSucceeded, kFailed };

struct RequestStatus {
  std::uint64_t id = 0;
  RequestOutcome outcome = RequestOutcome::kRefused;
  Phase phase = Phase::kNone;
  TimeNs t_ns = 0;
  double joint_value = 0;  // the object's joint as estimated from the hand, rad or m
  double joint_range = 0;
  Name reason;  // why refused or failed, empty otherwise
};

}  // namespace wb
