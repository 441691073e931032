// Between a joint's SI units and a drive's: counts = round(sign counts_per_unit (q - offset)).
// Velocities in counts/s, torques in thousandths of the rated torque (0x6071, 0x6077). Any world.
#pragma once
#include <cmath>
#include <cstdint>
#include <limits>

namespace wb::can {

struct UnitScale {
  double counts_per_unit = 1e5;      // counts per rad (or m)
  double sign = 1;                   // +1 or -1
  double offset = 0;                 // rad: the joint's position at 0 counts
  double torque_per_permille = 0.1;  // Nm (or N) per thousandth of the rated torque

  double position(std::int64_t counts) const noexcept {
    return offset + sign * static_cast<double>(counts) / counts_per_unit;
  }
  double velocity(std::int32_t counts_ps) const noexcept {
    return sign * counts_ps / counts_per_unit;
  }
  double torque(std::int16_t permille) const noexcept {
    return sign * permille * torque_per_permille;
  }
  // Unwrapped: the wire carries its lower 32 bits. 0 for what no drive can count.
  std::int64_t position_counts64(double q) const noexcept {
    const double v = sign * counts_per_unit * (q - offset);
    return !(v >= -1e18) ? 0 : v > 1e18 ? 0 : std::llround(v);
  }
  // What does not fit the field is clipped.
  std::int32_t velocity_counts(double dq) const noexcept {
    return clip<std::int32_t>(sign * counts_per_unit * dq);
  }
  std::int16_t torque_permille(double tau) const noexcept {
    return clip<std::int16_t>(sign * tau / torque_per_permille);
  }

 private:
  template <class T>
  static T clip(double v) noexcept {
    constexpr double low = std::numeric_limits<T>::min(), high = std::numeric_limits<T>::max();
    return static_cast<T>(!(v >= low) ? low : v > high ? high : std::nearbyint(v));
  }
};

}  // namespace wb::can
