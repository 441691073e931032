// JointProtocol: one drive as the bus master sees it, whatever it speaks; CiA 402 is the first
// implementation. Port world: one thread (its bus's), noexcept, no allocation. A cycle is
// collect (received() for each frame of the node), check(), transmit(), then the master's SYNC.
// SI units of the joint.
#pragma once
#include <cstdint>

#include "core/types/time.hpp"
#include "drivers/can/can_frame.hpp"

namespace wb::can {

enum class Goal : std::uint8_t {
  kOff,   // no power
  kOn,    // enabled, follows targets
  kStop,  // the time-out action: slows down by itself, never moves by a target
};

enum class StopAction : std::uint8_t { kHold, kDamped, kBrake };

struct JointTarget {
  bool given = false;  // false: hold what was measured when the drive was enabled
  double value = 0;    // position, velocity or torque, by the joint's kind
};

enum class JointStatus : std::uint8_t { kUnknown, kDisabled, kFollowing, kStopped, kFault, kLost };

struct JointMeasurement {
  double position = 0, velocity = 0, torque = 0;
  TimeNs t_ns = -1;    // of the sample; -1: none yet
  double quality = 0;  // share of the last second's samples that came in time
  JointStatus status = JointStatus::kLost;
  std::uint32_t error_code = 0;
  bool valid = false;
};

class JointProtocol {
 public:
  static constexpr int kFrames = 3;  // at most, from one transmit()
  virtual ~JointProtocol() = default;
  // Whether this frame is the drive's (by COB-ID); the master hands over no others.
  virtual bool owns(const Frame& frame) const RT_SAFE = 0;
  virtual void received(const Frame& frame) RT_SAFE = 0;
  // What the cycle that ends now has brought: reports missing answers and unsafe states. `goal`:
  // what the drive was last asked for.
  virtual void check(TimeNs now, Goal goal) RT_SAFE = 0;
  // Writes the cycle's frames to `out` and returns how many; they leave at `now`, SYNC after them.
  virtual int transmit(TimeNs now, Goal goal, const JointTarget& target, Frame* out) RT_SAFE = 0;
  // Identified, set up, its process data running.
  virtual bool ready() const RT_SAFE = 0;
  // Set-up that failed for good (an event said why); retry() starts it again.
  virtual bool failed() const RT_SAFE = 0;
  virtual void retry() RT_SAFE = 0;
  virtual void set_stop_action(StopAction action) RT_SAFE = 0;
  // What the drive calls itself; empty until it was asked. Any thread, after ready().
  virtual const char* device_name() const RT_SAFE = 0;
  virtual const JointMeasurement& measurement() const RT_SAFE = 0;
};

}  // namespace wb::can
