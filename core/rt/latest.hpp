// Latest<T, Readers>: one writer, newest value wins, wait-free on both sides; a value stays pinned
// while a reader uses it. Any threads; slots are allocated at construction. Each reader has a
// mailbox of one slot index. Publishing exchanges the new index into every mailbox; reading
// exchanges the mailbox for "empty". What an exchange returns tells the writer exactly which slot
// each reader holds: at most one each, plus the newest, plus the one being written: Readers + 2
// slots always suffice.
#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>

#include "core/rt/rt_safe.hpp"

namespace wb {

template <class T, int Readers = 1>
class Latest {
 public:
  static constexpr int kSlots = Readers + 2;

  Latest() : Latest(T{}) {}
  // Slots are copies of the prototype, so that values with storage of their own are allocated here
  // and never later.
  explicit Latest(const T& prototype) {
    for (auto& slot : slots_) slot = std::make_unique<T>(prototype);
    held_.fill(kEmpty);
  }

  // Writer: the slot to fill; stays the same until publish(). Its contents are those of some older
  // value.
  T& writing() RT_SAFE { return *slots_[writing_]; }

  // Writer: makes the slot the newest value, numbers it (T::seq = 1, 2, ...), and picks a free slot
  // for the next.
  std::uint64_t publish() RT_SAFE {
    slots_[writing_]->seq = ++seq_;
    for (int r = 0; r < Readers; ++r) {
      const int previous = mailbox_[r].exchange(writing_, std::memory_order_acq_rel);
      if (previous == kEmpty) held_[r] = newest_;  // the reader has taken what was put there last
    }
    newest_ = writing_;
    std::array<bool, kSlots> used{};
    used[newest_] = true;
    for (const int h : held_) {
      if (h != kEmpty) used[h] = true;
    }
    for (int i = 0; i < kSlots; ++i) {
      if (!used[i]) {
        writing_ = i;
        break;
      }
    }
    return seq_;
  }

  // Reader r: the newest value, or null before the first. It stays valid and unchanged until reader
  // r's next call.
  const T* read(int r = 0) RT_SAFE {
    const int taken = mailbox_[r].exchange(kEmpty, std::memory_order_acq_rel);
    if (taken != kEmpty) reading_[r] = taken;
    return reading_[r] == kEmpty ? nullptr : slots_[reading_[r]].get();
  }

 private:
  static constexpr int kEmpty = -1;
  static constexpr std::array<int, Readers> empties() {
    std::array<int, Readers> a{};
    a.fill(kEmpty);
    return a;
  }
  struct Mailbox {
    alignas(64) std::atomic<int> index{kEmpty};
    int exchange(int value, std::memory_order order) noexcept {
      return index.exchange(value, order);
    }
  };

  std::array<std::unique_ptr<T>, kSlots> slots_;
  std::array<Mailbox, Readers> mailbox_;
  // Writer's side.
  alignas(64) int writing_ = 0;
  int newest_ = kEmpty;
  std::uint64_t seq_ = 0;
  std::array<int, Readers> held_{};
  // Readers' side, one entry each.
  alignas(64) std::array<int, Readers> reading_ = empties();
};

}  // namespace wb
