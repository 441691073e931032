// Modes of the controller. The state machine lives in control/; everyone may name a mode.
#pragma once
#include <cstdint>
#include <string_view>

namespace wb {

enum class Mode : std::uint8_t {
  kIdle,      // drives inactive, readings only
  kReady,     // drives active, standing still, waits for a command
  kActive,    // carries out a command
  kDegraded,  // trouble: carries the command on at half speed, then stands still; leaves by reset
  kHold,      // trouble: stands still, keeps the grasp; leaves by reset
  kSettle,    // trouble: base braked at once, joints slowed down and held; leaves by reset
};

constexpr std::string_view to_string(Mode m) {
  switch (m) {
    case Mode::kIdle:
      return "idle";
    case Mode::kReady:
      return "ready";
    case Mode::kActive:
      return "active";
    case Mode::kDegraded:
      return "degraded";
    case Mode::kHold:
      return "hold";
    case Mode::kSettle:
      return "settle";
  }
  return "?";
}

// Phases of opening an object, run by the TaskSequencer while the mode is Active.
enum class Phase : std::uint8_t {
  kNone,
  kApproach,
  kPreGrasp,
  kGrasp,
  kManipulate,
  kRelease,
  kRetreat,
  kDone,
  kFailed,
};

constexpr std::string_view to_string(Phase p) {
  switch (p) {
    case Phase::kNone:
      return "none";
    case Phase::kApproach:
      return "approach";
    case Phase::kPreGrasp:
      return "pre-grasp";
    case Phase::kGrasp:
      return "grasp";
    case Phase::kManipulate:
      return "manipulate";
    case Phase::kRelease:
      return "release";
    case Phase::kRetreat:
      return "retreat";
    case Phase::kDone:
      return "done";
    case Phase::kFailed:
      return "failed";
  }
  return "?";
}

// Whether a request is being carried out: only then the MPC plans and control follows its policies.
constexpr bool task_runs(Mode m, Phase p) {
  return (m == Mode::kActive || m == Mode::kDegraded) && p != Phase::kNone && p != Phase::kDone &&
         p != Phase::kFailed;
}

}  // namespace wb
