// A stream of random numbers that depends on the plant's seed and the stream's number only
// (SplitMix64, Steele et al. 2014). Any world; no allocation.
#pragma once
#include <cmath>
#include <cstdint>
#include <numbers>

namespace wb::sim {

class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t stream) : state_(seed) {
    state_ = bits() ^ (stream * 0xd1342543de82ef95ULL);
  }

  std::uint64_t bits() noexcept {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15ULL);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    return z ^ (z >> 31);
  }
  // In (0, 1).
  double uniform() noexcept { return (static_cast<double>(bits() >> 12) + 0.5) * 0x1p-52; }
  // Standard normal (Box and Muller 1958).
  double gaussian() noexcept {
    const double radius = std::sqrt(-2.0 * std::log(uniform()));
    return radius * std::cos(2.0 * std::numbers::pi * uniform());
  }

 private:
  std::uint64_t state_;
};

// The streams of one plant; cameras count on from the last.
enum Stream : std::uint64_t {
  kSpawnStream = 1,
  kEncoderStream,
  kImuStream,
  kWrenchStream,
  kGripperStream,
  kCameraStream
};

}  // namespace wb::sim
