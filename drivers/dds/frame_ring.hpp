// The frames of one camera that wait for the daemon: filled in place by the DDS thread, lent to the
// reader in place (acquire_frame), never copied between. One writer, one reader, lock-free.
#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "core/types/time.hpp"

namespace wb::dds {

class FrameRing {
 public:
  static constexpr int kSlots = 6;

  explicit FrameRing(std::size_t pixels) {
    for (Slot& slot : slots_) slot.depth.resize(pixels);
  }

  // Writer. The slot to fill: a free one, else the oldest that nobody has taken (`lost` becomes
  // true); null if the reader holds them all.
  float* begin(bool& lost) noexcept {
    lost = false;
    for (writing_ = 0; writing_ < kSlots; ++writing_) {
      if (change(writing_, kFree, kWriting)) return slots_[writing_].depth.data();
    }
    while ((writing_ = oldest()) >= 0) {
      if (change(writing_, kReady, kWriting)) {
        lost = true;
        return slots_[writing_].depth.data();
      }
    }
    return nullptr;
  }
  void end(TimeNs t_ns) noexcept {
    slots_[writing_].t_ns = t_ns;
    slots_[writing_].number.store(++number_, std::memory_order_relaxed);
    slots_[writing_].state.store(kReady, std::memory_order_release);
  }
  void abandon() noexcept { slots_[writing_].state.store(kFree, std::memory_order_release); }

  // Reader. Index of the oldest waiting frame, or -1; its contents stay until release().
  int acquire() noexcept {
    for (;;) {
      const int i = oldest();
      if (i < 0 || change(i, kReady, kTaken)) return i;
    }
  }
  const float* depth(int i) const noexcept { return slots_[i].depth.data(); }
  TimeNs t_ns(int i) const noexcept { return slots_[i].t_ns; }
  bool release(int i) noexcept { return change(i, kTaken, kFree); }

 private:
  enum State : int { kFree, kWriting, kReady, kTaken };
  struct Slot {
    std::atomic<int> state{kFree};
    std::atomic<std::uint64_t> number{0};
    TimeNs t_ns = 0;
    std::vector<float> depth;
  };
  bool change(int i, int from, int to) noexcept {
    return slots_[i].state.compare_exchange_strong(from, to, std::memory_order_acq_rel);
  }
  int oldest() const noexcept {
    int found = -1;
    std::uint64_t number = UINT64_MAX;
    for (int i = 0; i < kSlots; ++i) {
      if (slots_[i].state.load(std::memory_order_acquire) != kReady) continue;
      const std::uint64_t n = slots_[i].number.load(std::memory_order_relaxed);
      if (n < number) {
        number = n;
        found = i;
      }
    }
    return found;
  }

  std::array<Slot, kSlots> slots_;
  int writing_ = 0;
  std::uint64_t number_ = 0;
};

}  // namespace wb::dds
