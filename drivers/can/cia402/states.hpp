// The CiA 402 state machine's tables: what a statusword says, which controlword leads where. Any
// world; pure. A statusword that the tables do not list is kUnknown, and unknown is not safe.
#pragma once
#include <cstdint>

namespace wb::can {

enum class DriveState : std::uint8_t {
  kUnknown,
  kNotReady,
  kSwitchOnDisabled,
  kReadyToSwitchOn,
  kSwitchedOn,
  kOperationEnabled,
  kQuickStopActive,
  kFaultReaction,
  kFault,
};

constexpr const char* name_of(DriveState s) {
  constexpr const char* kNames[] = {
      "unknown",     "not ready",         "switch on disabled", "ready to switch on",
      "switched on", "operation enabled", "quick stop active",  "fault reaction",
      "fault"};
  return kNames[static_cast<int>(s)];
}

constexpr DriveState state_of(std::uint16_t statusword) {
  switch (statusword & 0x4F) {
    case 0x00:
      return DriveState::kNotReady;
    case 0x40:
      return DriveState::kSwitchOnDisabled;
    case 0x0F:
      return DriveState::kFaultReaction;
    case 0x08:
      return DriveState::kFault;
    default:
      break;
  }
  switch (statusword & 0x6F) {
    case 0x21:
      return DriveState::kReadyToSwitchOn;
    case 0x23:
      return DriveState::kSwitchedOn;
    case 0x27:
      return DriveState::kOperationEnabled;
    case 0x07:
      return DriveState::kQuickStopActive;
    default:
      return DriveState::kUnknown;
  }
}

namespace statusword {
inline constexpr std::uint16_t kVoltage = 1u << 4, kWarning = 1u << 7, kRemote = 1u << 9,
                               kLimit = 1u << 11, kFollowing = 1u << 12,  // 1: follows its target
    kFollowingError = 1u << 13;
}
namespace controlword {
inline constexpr std::uint16_t kDisableVoltage = 0x00, kQuickStop = 0x02, kShutdown = 0x06,
                               kSwitchOn = 0x07, kEnable = 0x0F, kFaultReset = 0x80;
// Bits 0 to 3 of "enable operation": only such a frame lets a drive move by its targets.
constexpr bool enables(std::uint16_t word) { return (word & 0x8F) == kEnable; }
}  // namespace controlword

enum class DriveMode : std::int8_t { kNone = 0, kCsp = 8, kCsv = 9, kCst = 10 };

}  // namespace wb::can
