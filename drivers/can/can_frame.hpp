// One classical CAN frame as every port and bus hands it on, and how long it takes on the wire.
// Any world, any thread; trivially copyable. Stamps are on the clock of the port that received it.
// Bit times: CAN 2.0 with the worst case of bit stuffing (Tindell's bound), interframe space
// included: 135 bits for 8 bytes and an 11-bit identifier.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/time.hpp"

namespace wb::can {

struct Frame {
  std::uint32_t id =
      0;  // 11 bits; 29 where extended; the error class (linux/can/error.h) in errors
  std::uint8_t length = 0;  // bytes of data, 0 to 8
  bool extended = false;
  bool remote = false;
  bool error = false;  // an error frame: made by the controller, never on the wire
  std::array<std::uint8_t, 8> data{};
  TimeNs t_ns = 0;  // end of reception

  bool operator==(const Frame&) const = default;
};

constexpr int worst_case_bits(int length, bool extended) {
  const int stuffable = (extended ? 54 : 34) + 8 * length;
  return stuffable + 13 + (stuffable - 1) / 4;
}

constexpr TimeNs wire_time(const Frame& frame, double bit_rate) {
  return static_cast<TimeNs>(
      1e9 * worst_case_bits(frame.remote ? 0 : frame.length, frame.extended) / bit_rate);
}

// Little endian fields of a frame's data; the caller keeps `at` + width within 8 bytes.
constexpr std::uint64_t get_bytes(const std::uint8_t* data, int width) {
  std::uint64_t value = 0;
  for (int i = 0; i < width; ++i) value |= static_cast<std::uint64_t>(data[i]) << (8 * i);
  return value;
}
constexpr void put_bytes(std::uint8_t* data, int width, std::uint64_t value) {
  for (int i = 0; i < width; ++i) data[i] = static_cast<std::uint8_t>(value >> (8 * i));
}

}  // namespace wb::can
