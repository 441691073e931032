// The simulated bus: bit times, arbitration, queues, faults.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

#include "drivers/can/bus_load.hpp"
#include "drivers/can/in_process_bus.hpp"

namespace wb::can {
namespace {

Frame frame(std::uint32_t id, int length = 8) {
  Frame f;
  f.id = id;
  f.length = static_cast<std::uint8_t>(length);
  return f;
}

struct Listener final : BusParticipant {
  void received(const Frame& f) noexcept override { frames.push_back(f); }
  void step(TimeNs) noexcept override {}
  std::vector<Frame> frames;
};

// Most bits that CAN's rule (after five equal bits comes one of the other level, which counts for
// the next run) can make of so many: searched over all sequences, by run length.
int most_stuffed(int bits) {
  constexpr int kNever = -1;
  std::array<int, 6> best;  // by the length of the present run; level does not matter
  best.fill(kNever);
  best[1] = 1;
  for (int i = 1; i < bits; ++i) {
    std::array<int, 6> next;
    next.fill(kNever);
    const auto take = [&](int run, int length) {
      next[static_cast<std::size_t>(run)] = std::max(next[static_cast<std::size_t>(run)], length);
    };
    for (int run = 1; run <= 5; ++run) {
      const int length = best[static_cast<std::size_t>(run)];
      if (length == kNever) continue;
      if (run == 5) {         // a stuff bit of the other level comes first, a run of one
        take(2, length + 2);  // the next bit is like it
        take(1, length + 2);
      } else {
        take(run + 1, length + 1);
        take(1, length + 1);
      }
    }
    best = next;
  }
  return *std::max_element(best.begin(), best.end());
}

TEST(WireTime, EightBytesTakeAtMost135BitsAndNoSequenceOfBitsTakesMore) {
  EXPECT_EQ(worst_case_bits(8, false), 135);  // Tindell, Burns, Wellings
  EXPECT_EQ(worst_case_bits(8, true), 160);
  for (int bytes = 0; bytes <= 8; ++bytes) {
    const int stuffable = 34 + 8 * bytes;
    EXPECT_EQ(worst_case_bits(bytes, false), most_stuffed(stuffable) + 13) << bytes << " bytes";
  }
  EXPECT_EQ(wire_time(frame(1), 1e6), 135'000);
}

TEST(Bus, LowestIdentifierOfAllQueuesGoesFirst) {
  InProcessBus bus;
  CanPort& a = bus.attach("a");
  CanPort& b = bus.attach("b");
  Listener listener;
  bus.attach("listener", &listener);
  const Frame low[] = {frame(0x300), frame(0x100)}, high[] = {frame(0x200)};
  ASSERT_EQ(a.send(low, 2), 2);
  ASSERT_EQ(b.send(high, 1), 1);
  bus.advance(1'000'000);
  ASSERT_EQ(listener.frames.size(), 3u);
  // A queue is not reordered: 0x100 waits behind 0x300.
  EXPECT_EQ(listener.frames[0].id, 0x200u);
  EXPECT_EQ(listener.frames[1].id, 0x300u);
  EXPECT_EQ(listener.frames[2].id, 0x100u);
  EXPECT_EQ(listener.frames[0].t_ns, 135'000);
  EXPECT_EQ(listener.frames[2].t_ns, 405'000);
  EXPECT_EQ(a.status().received, 1u) << "its own frames do not come back";
}

TEST(Bus, QueueThatIsFullRefusesAndFlushForgets) {
  BusOptions options;
  options.transmit_queue = 3;
  InProcessBus bus(options);
  CanPort& port = bus.attach("port");
  Listener listener;
  bus.attach("listener", &listener);
  const std::vector<Frame> frames(5, frame(0x100));
  EXPECT_EQ(port.send(frames.data(), 5), 3);
  EXPECT_EQ(port.status().refused, 2u);
  bus.advance(100'000);  // the first is on the wire
  port.flush();
  bus.advance(10'000'000);
  EXPECT_EQ(listener.frames.size(), 1u);
  EXPECT_EQ(port.status().flushed, 2u);
}

TEST(Bus, BusOffHoldsTheQueueAndSendsItOnReturnUnlessItIsFlushed) {
  for (const bool flush : {false, true}) {
    InProcessBus bus;
    CanPort& port = bus.attach("port");
    Listener listener;
    bus.attach("listener", &listener);
    bus.set_link(port, LinkState::kBusOff, 5'000'000);
    const Frame stale = frame(0x201);
    ASSERT_EQ(port.send(&stale, 1), 1);
    bus.advance(4'000'000);
    EXPECT_EQ(listener.frames.size(), 0u);
    EXPECT_EQ(port.status().state, LinkState::kBusOff);
    if (flush) port.flush();
    bus.advance(20'000'000);
    EXPECT_EQ(port.status().state, LinkState::kActive);
    EXPECT_EQ(port.status().restarts, 1u);
    EXPECT_EQ(listener.frames.size(), flush ? 0u : 1u);
  }
}

TEST(Bus, FaultsDropDelayDoubleCorruptShortenAndReorder) {
  const auto run = [](FaultRule rule) {
    InProcessBus bus;
    CanPort& port = bus.attach("port");
    Listener listener;
    bus.attach("listener", &listener);
    rule.id = 0x181;
    rule.count = 1;
    bus.faults().add(rule);
    for (int i = 0; i < 3; ++i) {
      Frame f = frame(0x181);
      f.data[0] = static_cast<std::uint8_t>(i);
      port.send(&f, 1);
      bus.advance((i + 1) * 1'000'000);
    }
    bus.advance(20'000'000);
    return listener.frames;
  };
  FaultRule rule;
  EXPECT_EQ(run(rule).size(), 2u);
  rule.fault = FrameFault::kDuplicate;
  EXPECT_EQ(run(rule).size(), 4u);
  rule.fault = FrameFault::kDelay;
  rule.delay_ns = 10'000'000;
  EXPECT_EQ(run(rule)[2].data[0], 0);
  EXPECT_EQ(run(rule)[2].t_ns, 10'135'000);
  rule.fault = FrameFault::kCorrupt;
  rule.byte = 2;
  EXPECT_EQ(run(rule)[0].data[2], 0xFF);
  rule.fault = FrameFault::kLength;
  EXPECT_EQ(run(rule)[0].length, 2);
  rule.fault = FrameFault::kReorder;
  EXPECT_EQ(run(rule)[0].data[0], 1);
  EXPECT_EQ(run(rule)[1].data[0], 0);
}

TEST(Bus, ShareOfFaultsIsWhatWasAskedForAndRepeatable) {
  const auto dropped = [](std::uint64_t seed) {
    BusFaults faults(seed);
    FaultRule rule;
    rule.id = 0x181;
    rule.share = 0.1;
    faults.add(rule);
    for (int i = 0; i < 10'000; ++i) (void)faults.hit(frame(0x181));
    return faults.hits();
  };
  EXPECT_EQ(dropped(1), dropped(1));
  EXPECT_NE(dropped(1), dropped(2));
  EXPECT_NEAR(static_cast<double>(dropped(1)), 1000, 5 * 30);  // 5 sigma of the binomial
}

TEST(BusLoad, IsWhatTheSimulatedBusMeasures) {
  InProcessBus bus;
  CanPort& port = bus.attach("port");
  bus.attach("other");
  Supervision s;
  s.heartbeat_ms = 1000;
  const std::vector<DriveMode> drives(4, DriveMode::kCsp);
  // A second of exactly the frames that the formula counts.
  for (int k = 0; k < 400; ++k) {
    for (int i = 0; i < 4; ++i) {
      for (const int bytes : {7, 8, 7}) {
        const Frame f = frame(0x100, bytes);
        ASSERT_EQ(port.send(&f, 1), 1);
      }
    }
    const Frame sync = frame(0x80, 0);
    ASSERT_EQ(port.send(&sync, 1), 1);
    if (k < 5) {
      const Frame beat = frame(0x700, 1);
      ASSERT_EQ(port.send(&beat, 1), 1);
    }
    bus.advance((k + 1) * 2'500'000);
  }
  EXPECT_NEAR(bus_load(drives, s, 1e6), bus.load(), 1e-9);
}

}  // namespace
}  // namespace wb::can
