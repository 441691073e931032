// Time is int64 nanoseconds, monotonic (RealTime) or virtual (Lockstep); never the wall calendar.
#pragma once
#include <cstdint>

namespace wb {

using TimeNs = std::int64_t;

inline constexpr TimeNs kNanosPerSecond = 1'000'000'000;
constexpr double to_seconds(TimeNs t) { return 1e-9 * static_cast<double>(t); }
constexpr TimeNs from_seconds(double s) {
  return static_cast<TimeNs>(s * 1e9 + (s < 0 ? -0.5 : 0.5));
}

}  // namespace wb
