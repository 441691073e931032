// Queue<T, N>: bounded, lock-free, one writer, one reader; what does not fit is dropped and
// counted, never waited for. Any two threads; N slots are allocated at construction. Large values
// are filled and read in place (begin_push, front).
#pragma once
#include <atomic>
#include <cstdint>
#include <vector>

#include "core/rt/rt_safe.hpp"

namespace wb {

template <class T, std::size_t N>
class Queue {
 public:
  Queue() : slots_(N) {}
  explicit Queue(const T& prototype) : slots_(N, prototype) {}
  Queue(const Queue&) = delete;
  Queue& operator=(const Queue&) = delete;

  // Writer. begin_push() returns the slot to fill, or null (counted as a drop) when the queue is
  // full; end_push() hands it over.
  T* begin_push() RT_SAFE {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head - tail_.load(std::memory_order_acquire) >= N) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      return nullptr;
    }
    return &slots_[head % N];
  }
  void end_push() RT_SAFE {
    head_.store(head_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }
  bool push(const T& value) RT_SAFE {
    T* slot = begin_push();
    if (!slot) return false;
    *slot = value;
    end_push();
    return true;
  }

  // Reader. peek(i) is the i-th waiting value (0 = oldest) or null; pop() releases the oldest.
  const T* peek(std::size_t i = 0) RT_SAFE {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (head_.load(std::memory_order_acquire) - tail <= i) return nullptr;
    return &slots_[(tail + i) % N];
  }
  void pop() RT_SAFE {
    tail_.store(tail_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
  }
  bool pop(T& value) RT_SAFE {
    const T* front = peek();
    if (!front) return false;
    value = *front;
    pop();
    return true;
  }

  std::uint64_t dropped() const RT_SAFE { return dropped_.load(std::memory_order_relaxed); }
  static constexpr std::size_t capacity() { return N; }

 private:
  std::vector<T> slots_;
  alignas(64) std::atomic<std::uint64_t> head_{0};
  alignas(64) std::atomic<std::uint64_t> tail_{0};
  std::atomic<std::uint64_t> dropped_{0};
};

}  // namespace wb
