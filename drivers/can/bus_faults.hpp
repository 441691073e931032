// What can go wrong with a frame between two participants of a simulated bus. Setup and tests only
// write; the bus asks. Seeded: the same rules give the same faults.
#pragma once
#include <cstdint>
#include <vector>

#include "drivers/can/can_frame.hpp"

namespace wb::can {

enum class FrameFault : std::uint8_t {
  kDrop,
  kDelay,      // delivered delay_ns later
  kDuplicate,  // delivered twice
  kCorrupt,    // data[byte] ^= flip (a gateway's fault: on the wire the CRC would find it)
  kLength,     // delivered with `byte` bytes
  kReorder,    // held back, delivered after the next frame that matches
};

struct FaultRule {
  FrameFault fault = FrameFault::kDrop;
  std::uint32_t id = 0;  // the frames that match: (frame.id & mask) == id
  std::uint32_t mask = 0x7FF;
  int skip = 0;        // leaves the first ones alone
  int count = -1;      // then hits so many, -1: all
  double share = 1.0;  // of those, by chance
  TimeNs delay_ns = 0;
  int byte = 0;
  std::uint8_t flip = 0xFF;
};

class BusFaults {
 public:
  explicit BusFaults(std::uint64_t seed = 1) : random_(seed ? seed : 1) {}
  void add(const FaultRule& rule) { rules_.push_back(rule); }
  void clear() { rules_.clear(); }
  // The first rule that hits this frame, or null.
  const FaultRule* hit(const Frame& frame) noexcept {
    for (FaultRule& rule : rules_) {
      if (rule.count == 0 || (frame.id & rule.mask) != rule.id) continue;
      if (rule.skip > 0) {
        --rule.skip;
        continue;
      }
      if (rule.share < 1.0 && chance() >= rule.share) continue;
      if (rule.count > 0) --rule.count;
      ++hits_;
      return &rule;
    }
    return nullptr;
  }
  std::uint64_t hits() const { return hits_; }

 private:
  double chance() noexcept {  // xorshift64
    random_ ^= random_ << 13;
    random_ ^= random_ >> 7;
    random_ ^= random_ << 17;
    return static_cast<double>(random_ >> 11) * 0x1p-53;
  }
  std::vector<FaultRule> rules_;
  std::uint64_t random_;
  std::uint64_t hits_ = 0;
};

}  // namespace wb::can
