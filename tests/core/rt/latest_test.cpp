// Latest under one writer and several readers: torn or released values would break the checksum or
// the order.
#include "core/rt/latest.hpp"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <thread>
#include <vector>

namespace wb {
namespace {

struct Value {
  std::uint64_t seq = 0;
  std::array<std::uint64_t, 64> words{};
  void fill(std::uint64_t v) { words.fill(v); }
  bool whole() const {
    for (const auto w : words) {
      if (w != words[0]) return false;
    }
    return true;
  }
};

TEST(Latest, IsEmptyBeforeTheFirstValue) {
  Latest<Value, 2> latest;
  EXPECT_EQ(latest.read(0), nullptr);
  EXPECT_EQ(latest.read(1), nullptr);
}

TEST(Latest, NewestValueWinsAndStaysPinned) {
  Latest<Value, 2> latest;
  latest.writing().fill(1);
  latest.publish();
  const Value* pinned = latest.read(0);
  for (std::uint64_t v = 2; v < 20; ++v) {
    latest.writing().fill(v);
    latest.publish();
    EXPECT_EQ(pinned->words[0], 1u);
    EXPECT_EQ(latest.read(1)->words[0], v);
  }
  EXPECT_EQ(latest.read(0)->words[0], 19u);
  EXPECT_EQ(latest.read(0)->seq, 19u);
}

TEST(Latest, WriterNeverGetsASlotThatAReaderHolds) {
  Latest<Value, 3> latest;
  const Value* held[3] = {};
  for (std::uint64_t v = 1; v < 200; ++v) {
    for (const Value* h : held) ASSERT_NE(h, &latest.writing());
    latest.writing().fill(v);
    latest.publish();
    held[v % 3] = latest.read(static_cast<int>(v % 3));
    if (v % 7 == 0) held[0] = latest.read(0);
  }
}

// The three regimes differ in who is faster: readers idle most of the time (overflowing), readers
// spinning (empty), both alike.
void stress(int writer_pause, int reader_pause) {
  constexpr int kReaders = 3;
  constexpr std::uint64_t kValues = 10'000;
  Latest<Value, kReaders> latest;
  std::atomic<bool> done{false};
  std::atomic<int> faults{0};
  std::vector<std::thread> readers;
  for (int r = 0; r < kReaders; ++r) {
    readers.emplace_back([&, r] {
      std::uint64_t last = 0;
      while (!done.load(std::memory_order_acquire)) {
        if (const Value* v = latest.read(r)) {
          const std::uint64_t first = v->words[0];
          for (int i = 0; i < reader_pause; ++i) std::this_thread::yield();
          if (!v->whole() || v->words[0] != first || v->seq != first || first < last) ++faults;
          if (first == last) std::this_thread::yield();
          last = first;
        } else {
          std::this_thread::yield();
        }
      }
      const Value* v = latest.read(r);
      if (!v || v->words[0] != kValues) ++faults;
    });
  }
  for (std::uint64_t v = 1; v <= kValues; ++v) {
    latest.writing().fill(v);
    latest.publish();
    for (int i = 0; i < writer_pause; ++i) std::this_thread::yield();
  }
  done.store(true, std::memory_order_release);
  for (auto& t : readers) t.join();
  EXPECT_EQ(faults.load(), 0);
}

TEST(Latest, ReaderNeverSeesTornValueWhenReadersAreFaster) { stress(2, 0); }
TEST(Latest, ReaderNeverSeesTornValueWhenTheWriterIsFaster) { stress(0, 5); }
TEST(Latest, ReaderNeverSeesTornValueWhenBothKeepPace) { stress(1, 1); }

}  // namespace
}  // namespace wb
