// CanPort: one participant's access to a CAN bus. Port world: noexcept, non-blocking, allocates
// nothing; one thread a port. What `send` does not take is refused and counted, never kept by the
// caller's back; `flush` forgets every frame that has not reached the wire, so that nothing queued
// before a stop is sent after it. Error frames show in `status`, `receive` does not hand them out.
// Implementations: SocketCanPort (kernel), InProcessBus (deterministic), SocketBusPort (Unix
// socket).
#pragma once
#include <cstdint>

#include "core/rt/rt_safe.hpp"
#include "drivers/can/can_frame.hpp"

namespace wb::can {

enum class LinkState : std::uint8_t {
  kActive,   // error-active
  kWarning,  // an error counter above 96
  kPassive,  // an error counter above 127
  kBusOff,   // the controller has left the bus
  kDown,     // the interface is down
  kGone,     // the interface, or the bus's server, does not exist any more
};
constexpr bool carries_frames(LinkState s) { return s < LinkState::kBusOff; }
constexpr const char* name_of(LinkState s) {
  constexpr const char* kNames[] = {"active", "warning", "passive", "bus-off", "down", "gone"};
  return kNames[static_cast<int>(s)];
}

// Counters since the port was opened.
struct PortStatus {
  LinkState state = LinkState::kActive;
  std::uint64_t sent = 0;
  std::uint64_t received = 0;
  std::uint64_t refused = 0;       // frames that send() did not take: queue full, no link
  std::uint64_t flushed = 0;       // frames forgotten by flush()
  std::uint64_t overruns = 0;      // frames lost because nobody received them
  std::uint64_t error_frames = 0;  // reported by the controller
  std::uint64_t bus_offs = 0;
  std::uint64_t restarts = 0;  // returns from bus-off
};

class CanPort {
 public:
  virtual ~CanPort() = default;
  // Queues frames in order; returns how many were taken (the first ones).
  virtual int send(const Frame* frames, int count) RT_SAFE = 0;
  // Takes received frames, oldest first; returns how many, at most `capacity`.
  virtual int receive(Frame* frames, int capacity) RT_SAFE = 0;
  virtual void flush() RT_SAFE = 0;
  virtual PortStatus status() RT_SAFE = 0;
  // Readable when frames wait; -1 where there is nothing to wait on (virtual clock).
  virtual int file() const RT_SAFE { return -1; }
  // After kDown or kGone: looks for the interface (by name) or the server again. Bounded, may call
  // the kernel a few times; false: still not there.
  virtual bool reopen() RT_SAFE { return false; }
};

}  // namespace wb::can
