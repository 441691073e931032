// The Robotiq 2F-85's registers: orders and status in SI units, to and from its bytes. Any world.
// Opening: total distance between the pads [m]. Source: Robotiq 2F-85 & 2F-140 instruction manual,
// "Control": output registers 0x03E8 to 0x03EA, input registers 0x07D0 to 0x07D2, high byte first.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace wb::robotiq {

inline constexpr int kOrderAddress = 0x03E8, kStatusAddress = 0x07D0;
inline constexpr int kRegisters = 3;
using Registers = std::array<std::uint16_t, kRegisters>;

inline constexpr double kForceMin_n = 20, kForceMax_n = 235;         // per finger
inline constexpr double kSpeedMin_mps = 0.02, kSpeedMax_mps = 0.15;  // of the opening

// How counts of position stand for an opening; both ends are measured once on the real gripper.
struct Stroke {
  double opening_max_m = 0;
  int open_counts = 0, closed_counts = 255;
};

namespace detail {
inline std::uint8_t byte(double value) {
  return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0)));
}
inline std::uint8_t scaled(double value, double low, double high) {
  return byte(255 * (value - low) / (high - low));
}
}  // namespace detail

inline std::uint8_t position_counts(double opening_m, const Stroke& s) {
  const double shut = 1 - std::clamp(opening_m / s.opening_max_m, 0.0, 1.0);
  return detail::byte(s.open_counts + shut * (s.closed_counts - s.open_counts));
}
inline double opening_m(std::uint8_t counts, const Stroke& s) {
  const double shut =
      static_cast<double>(counts - s.open_counts) / (s.closed_counts - s.open_counts);
  return s.opening_max_m * std::clamp(1 - shut, 0.0, 1.0);
}
inline std::uint8_t force_counts(double force_n) {
  return detail::scaled(force_n, kForceMin_n, kForceMax_n);
}
inline double force_n(std::uint8_t counts) {
  return kForceMin_n + counts / 255.0 * (kForceMax_n - kForceMin_n);
}
inline std::uint8_t speed_counts(double speed_mps) {
  return detail::scaled(speed_mps, kSpeedMin_mps, kSpeedMax_mps);
}
inline double speed_mps(std::uint8_t counts) {
  return kSpeedMin_mps + counts / 255.0 * (kSpeedMax_mps - kSpeedMin_mps);
}

struct Order {
  bool activate = false;  // rACT
  bool go = false;        // rGTO: move to the position
  std::uint8_t position = 0, speed = 0, force = 0;

  Registers encode() const {
    return {static_cast<std::uint16_t>((activate ? 0x0100 : 0) | (go ? 0x0800 : 0)), position,
            static_cast<std::uint16_t>(speed << 8 | force)};
  }
  static Order decode(const Registers& r) {
    return {(r[0] & 0x0100) != 0, (r[0] & 0x0800) != 0, static_cast<std::uint8_t>(r[1] & 0xFF),
            static_cast<std::uint8_t>(r[2] >> 8), static_cast<std::uint8_t>(r[2] & 0xFF)};
  }
  bool operator==(const Order&) const = default;
};

enum class Activation : std::uint8_t { kReset = 0, kRunning = 1, kDone = 3 };
enum class Motion : std::uint8_t {
  kMoving = 0,
  kObjectOpening = 1,
  kObjectClosing = 2,
  kThere = 3
};
enum Fault : std::uint8_t {
  kNoFault = 0,
  kActionDelayed = 0x05,
  kNotActivated = 0x07,
  kNoCommunication = 0x09,  // for a second; the gripper has stopped
  // From here on only a reset and a new activation help.
  kUndervoltage = 0x0A,
  kAutomaticRelease = 0x0B,
  kInternal = 0x0C,
  kActivationFault = 0x0D,
  kOvercurrent = 0x0E,
  kReleased = 0x0F,
};

struct Status {
  bool active = false, going = false;  // gACT, gGTO
  Activation activation = Activation::kReset;
  Motion motion = Motion::kMoving;  // means something while going
  std::uint8_t fault = kNoFault;
  std::uint8_t position_echo = 0, position = 0;
  std::uint8_t current = 0;  // in 10 mA

  bool touches() const {
    return going && (motion == Motion::kObjectOpening || motion == Motion::kObjectClosing);
  }
  bool needs_reset() const { return fault >= kUndervoltage; }

  Registers encode() const {
    const unsigned status = (active ? 0x01u : 0u) | (going ? 0x08u : 0u) |
                            static_cast<unsigned>(activation) << 4 |
                            static_cast<unsigned>(motion) << 6;
    return {static_cast<std::uint16_t>(status << 8),
            static_cast<std::uint16_t>(fault << 8 | position_echo),
            static_cast<std::uint16_t>(position << 8 | current)};
  }
  static Status decode(const Registers& r) {
    const unsigned status = r[0] >> 8;
    return {(status & 0x01) != 0,
            (status & 0x08) != 0,
            static_cast<Activation>(status >> 4 & 3),
            static_cast<Motion>(status >> 6 & 3),
            static_cast<std::uint8_t>(r[1] >> 8 & 0x0F),
            static_cast<std::uint8_t>(r[1] & 0xFF),
            static_cast<std::uint8_t>(r[2] >> 8),
            static_cast<std::uint8_t>(r[2] & 0xFF)};
  }
};

}  // namespace wb::robotiq
