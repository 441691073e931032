#include "drivers/dds/low_level/session_clock.hpp"

namespace wb::dds {
namespace {

// A new host is followed only when the present one has been silent for this long.
constexpr TimeNs kSessionSilenceNs = kNanosPerSecond;
// Keeps sums and differences of times from overflowing.
constexpr TimeNs kTimeMaxNs = INT64_MAX / 4;

}  // namespace

SessionClock::Verdict SessionClock::take(const msg::Tick& t, TimeNs wall_ns) noexcept {
  if (t.session_ == 0 || t.t_ns_ < 0 || t.t_ns_ > kTimeMaxNs) return Verdict::kRefused;
  const bool other = t.session_ != session_;
  if (other) {
    if (session_ != 0 && wall_ns - heard_ns_ < kSessionSilenceNs) return Verdict::kRefused;
    session_ = t.session_;
    offset_ns_ = robot_ns_ - t.t_ns_;
    tick_ = 0;
  } else if (t.number_ < tick_ || robot_ns(t) < robot_ns_ || robot_ns(t) > kTimeMaxNs) {
    return Verdict::kRefused;
  }
  heard_ns_ = wall_ns;
  return t.number_ > tick_ ? Verdict::kGoOn : Verdict::kAgain;
}

}  // namespace wb::dds
