// Time of a paced robot: it follows the ticks of one host's session at a time; the robot's own time
// never goes back, whatever time a host begins at. Pure: what a fuzzer drives. Step world.
#pragma once
#include <cstdint>

#include "drivers/dds/messages.hpp"

namespace wb::dds {

class SessionClock {
 public:
  enum class Verdict {
    kRefused,
    kAgain,  // nothing passes, the answer is given once more
    kGoOn,   // to robot_ns(tick)
  };
  // wall_ns: any steady clock. A tick of another session turns the clock to its host's time.
  Verdict take(const msg::Tick& tick, TimeNs wall_ns) noexcept;
  TimeNs robot_ns(const msg::Tick& tick) const noexcept { return tick.t_ns_ + offset_ns_; }

  void reach(TimeNs robot_ns) noexcept { robot_ns_ = robot_ns; }
  void answer(const msg::Tick& tick) noexcept { tick_ = tick.number_; }

  TimeNs now_ns() const { return robot_ns_; }
  TimeNs host_ns() const { return robot_ns_ - offset_ns_; }
  TimeNs offset_ns() const { return offset_ns_; }  // robot's time = the host's + offset
  std::uint64_t session() const { return session_; }
  std::uint64_t tick() const { return tick_; }  // the newest that was answered

 private:
  std::uint64_t session_ = 0, tick_ = 0;
  TimeNs heard_ns_ = 0, robot_ns_ = 0, offset_ns_ = 0;
};

}  // namespace wb::dds
