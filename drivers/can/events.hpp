// What the CAN driver notices: one list of kinds gives the counters' names (wb.diagnostics/1), the
// log lines, and which of them stop the robot. Records are fixed-size: ports make them, an ordinary
// thread turns them into text.
#pragma once
#include <array>
#include <cstdint>
#include <string>

#include "core/rt/rt_safe.hpp"
#include "core/types/time.hpp"

namespace wb::can {

enum class Event : std::uint8_t {
  // These stop all drives, latched until the next activate.
  kCommandTimeout,
  kStopRequested,
  kTpdoLost,
  kHeartbeatLost,
  kNmtState,
  kBootUp,
  kEmergency,
  kDriveFault,
  kUnknownStatusword,
  kQuickStopActive,
  kNotEnabled,
  kModeMismatch,
  kInternalLimit,
  kFollowingErrorBit,
  kNotFollowing,
  kPositionJump,
  kPositionRange,
  kDuplicateNode,
  kSecondMaster,
  kTransmitRefused,
  kBusOff,
  kBusOffLimit,
  kLinkDown,
  kLinkGone,
  kBusTimeout,
  kEnableTimeout,
  kResetLimit,
  kSdoTimeout,
  kSdoAbort,
  kSdoToggle,
  kIdentity,
  kModeUnsupported,
  kMappingDiffers,
  // These are counted (and the first of a second logged); nothing stops.
  kTpdoMissed,
  kTpdoLate,
  kTpdoDuplicate,
  kPdoLength,
  kForeignFrame,
  kErrorReset,
  kCommandRejected,
  kCommandStale,
  kErrorFrames,
  kErrorPassive,
  kReceiveOverrun,
  kLinkBack,
  kDriveReady,
  kPriorityRefused,
  kLogDropped,
};
inline constexpr int kEvents = static_cast<int>(Event::kLogDropped) + 1;
inline constexpr Event kLastStop = Event::kMappingDiffers;
constexpr bool stops(Event e) { return e <= kLastStop; }

struct EventText {
  const char* name;  // of the counter
  const char* text;  // of the log line; `value` is printed after it, in hexadecimal where `hex`
  bool hex = false;
};
const EventText& text_of(Event event);

struct EventRecord {
  TimeNs t_ns = 0;
  Event event{};
  int bus = -1;
  int drive = -1;  // index in the driver's list, -1: the bus itself
  std::uint32_t value = 0;
};

// Where drives and buses report. Ports: bounded, allocates nothing.
class EventSink {
 public:
  virtual ~EventSink() = default;
  virtual void report(const EventRecord& record, std::uint64_t times = 1) RT_SAFE = 0;
};

}  // namespace wb::can
