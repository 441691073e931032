// Queue with one writer and one reader: nothing lost but what is counted, order kept.
#include "core/rt/queue.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace wb {
namespace {

struct Item {
  std::uint64_t number = 0;
  std::uint64_t copy = 0;
};

TEST(Queue, DropsAndCountsWhatDoesNotFit) {
  Queue<int, 4> queue;
  for (int i = 0; i < 6; ++i) EXPECT_EQ(queue.push(i), i < 4);
  EXPECT_EQ(queue.dropped(), 2u);
  EXPECT_EQ(*queue.peek(3), 3);
  EXPECT_EQ(queue.peek(4), nullptr);
  int value = -1;
  for (int i = 0; i < 4; ++i) {
    ASSERT_TRUE(queue.pop(value));
    EXPECT_EQ(value, i);
  }
  EXPECT_FALSE(queue.pop(value));
}

void stress(int writer_pause, int reader_pause) {
  constexpr std::uint64_t kItems = 60'000;
  Queue<Item, 16> queue;
  std::atomic<bool> done{false};
  std::uint64_t taken = 0, faults = 0;
  std::thread reader([&] {
    std::uint64_t last = 0;
    for (;;) {
      const bool finished = done.load(std::memory_order_acquire);
      while (const Item* item = queue.peek()) {
        if (item->number <= last || item->copy != ~item->number) ++faults;
        last = item->number;
        queue.pop();
        ++taken;
        for (int i = 0; i < reader_pause; ++i) std::this_thread::yield();
      }
      if (finished) break;
      std::this_thread::yield();
    }
  });
  for (std::uint64_t n = 1; n <= kItems; ++n) {
    queue.push({n, ~n});
    for (int i = 0; i < writer_pause; ++i) std::this_thread::yield();
  }
  done.store(true, std::memory_order_release);
  reader.join();
  EXPECT_EQ(faults, 0u);
  EXPECT_EQ(taken + queue.dropped(), kItems);
}

TEST(Queue, KeepsOrderAndAccountsWhenMostlyEmpty) { stress(3, 0); }
TEST(Queue, KeepsOrderAndAccountsWhenOverflowing) { stress(0, 5); }
TEST(Queue, KeepsOrderAndAccountsWhenSteady) { stress(1, 1); }

}  // namespace
}  // namespace wb
