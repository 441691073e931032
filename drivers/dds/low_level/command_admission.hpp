// What becomes of each JointCommands message on the low-level computer: lease, order, age and the
// latch of a stop decide whether it reaches the joints. Pure: what a fuzzer drives. Step world.
#pragma once
#include <cstdint>

#include "drivers/dds/low_level/command_filter.hpp"

namespace wb::dds {

class CommandAdmission {
 public:
  // What holds when a message is taken.
  struct Moment {
    std::uint64_t lease = 0;  // the holder's; 0: nobody's
    TimeNs stamp_ns = 0;      // on the stamps' clock
    TimeNs memory_ns = 0;     // older commands are refused; 0: any age
    TimeNs now_ns = 0;        // on the clock of commands' validity
    bool emergency_stop = false;
  };
  enum class Verdict {
    kRefused,  // refusal() says why
    kStop,     // the time-out action, now
    kStopped,  // asked to stop once more: nothing to do
    kApply,
  };

  explicit CommandAdmission(const wb_description& robot) : robot_(robot) {}

  // A new lease moves nothing yet. An end: true if the joints must be stopped.
  void begin_lease() noexcept;
  bool end_lease() noexcept;

  Verdict take(const msg::JointCommands& command, const Moment& moment, wb_commands& out) noexcept;
  // The lease moves nothing any more.
  void latch_stop() noexcept { stopped_ = true; }

  bool moving() const { return commanded_ && !stopped_; }
  bool commanded() const { return commanded_; }  // the lease has moved something
  bool stopped() const { return stopped_; }
  // When the joints must stop unless another command comes; far away if nothing moves.
  TimeNs deadline_ns() const { return moving() ? command_ns_ + valid_for_ns_ : INT64_MAX; }
  std::uint64_t sequence() const { return sequence_; }              // newest that was accepted
  std::uint64_t heard_sequence() const { return heard_sequence_; }  // newest at all
  const char* refusal() const { return refusal_; }  // of the newest command; empty: accepted

 private:
  const char* reason(const msg::JointCommands& command, const Moment& moment) const noexcept;

  const wb_description robot_;
  bool commanded_ = false, stopped_ = false;
  std::uint64_t sequence_ = 0, heard_sequence_ = 0;
  TimeNs command_ns_ = 0, valid_for_ns_ = 0;
  const char* refusal_ = "";
};

}  // namespace wb::dds
