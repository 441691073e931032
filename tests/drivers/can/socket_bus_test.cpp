// The bus over a Unix socket: same medium, paced ticks, and what happens when the hub goes away.
// SocketCanPort on a kernel without CAN.
#include "drivers/can/socket_bus.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <thread>

#include "drivers/can/socket_can_port.hpp"

namespace wb::can {
namespace {

std::filesystem::path socket_path(const char* name) {
  return std::filesystem::temp_directory_path() /
         ("wb_can_" + std::to_string(::getpid()) + "_" + name);
}

Frame frame(std::uint32_t id) {
  Frame f;
  f.id = id;
  f.length = 8;
  return f;
}

// Answers each SYNC at once.
struct Answerer final : BusParticipant {
  explicit Answerer(InProcessBus& bus) : port(bus.attach("answerer", this)) {}
  void received(const Frame& f) noexcept override {
    if (f.id != 0x80) return;
    const Frame reply = frame(0x181);
    port.send(&reply, 1);
  }
  void step(TimeNs) noexcept override {}
  CanPort& port;
};

// Serves a paced hub until it is told to end.
struct PacedHub {
  explicit PacedHub(const std::filesystem::path& path)
      : hub(path, true), answerer(hub.bus()), thread([this] {
          while (!ends) {
            const auto tick = hub.requested_tick(5);
            if (!tick) continue;
            hub.bus().advance(tick->bus_ns);
            last_host_ns = tick->host_ns;
            hub.finish_tick();
          }
        }) {}
  ~PacedHub() {
    ends = true;
    thread.join();
  }
  SocketBus hub;
  Answerer answerer;
  std::atomic<bool> ends{false};
  std::atomic<TimeNs> last_host_ns{0};
  std::thread thread;
};

TEST(SocketBus, PacedTickBringsEveryAnswerOfTheTickWithVirtualStamps) {
  const auto path = socket_path("paced");
  PacedHub hub(path);
  SocketBusPort port(path, true);
  EXPECT_EQ(port.bus_time(), 0);
  for (int k = 1; k <= 20; ++k) {
    const TimeNs start = port.bus_time();
    Frame sync = frame(0x80);
    sync.length = 0;
    ASSERT_EQ(port.send(&sync, 1), 1);
    ASSERT_TRUE(port.advance({k * 2'500'000, 1000 + k}, 10'000));
    EXPECT_EQ(port.bus_time(), k * 2'500'000);
    std::array<Frame, 8> frames;
    ASSERT_EQ(port.receive(frames.data(), 8), 1);
    EXPECT_EQ(frames[0].id, 0x181u);
    EXPECT_EQ(frames[0].t_ns, start + 55'000 + 135'000);  // SYNC, then 8 bytes
  }
  EXPECT_EQ(hub.last_host_ns, 1020);
}

TEST(SocketBus, FlushedFramesOfATickNeverReachTheBus) {
  const auto path = socket_path("flush");
  PacedHub hub(path);
  SocketBusPort port(path, true);
  Frame sync = frame(0x80);
  ASSERT_EQ(port.send(&sync, 1), 1);
  port.flush();
  ASSERT_TRUE(port.advance({2'500'000, 0}, 10'000));
  std::array<Frame, 8> frames;
  EXPECT_EQ(port.receive(frames.data(), 8), 0);
  EXPECT_EQ(port.status().flushed, 1u);
}

TEST(SocketBus, PortSaysThatTheHubHasGoneAndFindsTheNextOne) {
  const auto path = socket_path("gone");
  auto hub = std::make_unique<PacedHub>(path);
  SocketBusPort port(path, true);
  ASSERT_TRUE(port.advance({1'000'000, 0}, 10'000));
  hub.reset();
  EXPECT_FALSE(port.advance({2'000'000, 0}, 10'000));
  EXPECT_EQ(port.status().state, LinkState::kGone);
  EXPECT_FALSE(port.reopen());
  const Frame f = frame(1);
  EXPECT_EQ(port.send(&f, 1), 0);
  hub = std::make_unique<PacedHub>(path);
  EXPECT_TRUE(port.reopen());
  EXPECT_TRUE(port.advance({1'000'000, 0}, 10'000));
}

TEST(SocketBus, HubThatDoesNotFinishItsTickIsNotWaitedForForEver) {
  const auto path = socket_path("stuck");
  SocketBus hub(path, true);
  std::thread accepter([&] { (void)hub.requested_tick(2000); });
  SocketBusPort port(path, true);
  EXPECT_FALSE(port.advance({1'000'000, 0}, 30));
  accepter.join();
  EXPECT_EQ(port.status().state, LinkState::kActive);
}

TEST(SocketBus, ClientsOfARealTimeBusHearEachOther) {
  const auto path = socket_path("real");
  SocketBus hub(path, false);
  std::atomic<bool> ends{false};
  std::thread pump([&] {
    timespec t;
    while (!ends) {
      clock_gettime(CLOCK_MONOTONIC, &t);
      hub.pump(static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec);
      const timespec wait{0, 500'000};
      nanosleep(&wait, nullptr);
    }
  });
  {
    SocketBusPort a(path, false), b(path, false);
    const Frame sent = frame(0x123);
    ASSERT_EQ(a.send(&sent, 1), 1);
    Frame got;
    int n = 0;
    for (int i = 0; i < 5000 && n == 0; ++i) {
      n = b.receive(&got, 1);
      const timespec wait{0, 1'000'000};
      if (n == 0) nanosleep(&wait, nullptr);
    }
    ASSERT_EQ(n, 1);
    EXPECT_EQ(got.id, 0x123u);
    EXPECT_EQ(a.receive(&got, 1), 0) << "not its own";
  }
  ends = true;
  pump.join();
}

TEST(SocketBus, NobodyThereIsAnErrorThatNamesThePath) {
  try {
    SocketBusPort port(socket_path("nobody"), true);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("nobody"), std::string::npos) << error.what();
  }
}

TEST(SocketBus, PacedAndRealTimeDoNotMix) {
  const auto path = socket_path("mixed");
  PacedHub hub(path);
  EXPECT_THROW(SocketBusPort(path, false), std::runtime_error);
}

TEST(SocketCan, InterfaceThatIsNotThereIsAnErrorThatNamesItAndTheCause) {
  try {
    SocketCanPort port("wbnocan0", 1e6);
    FAIL();
  } catch (const std::runtime_error& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("wbnocan0"), std::string::npos) << text;
    EXPECT_TRUE(text.find("no CAN") != std::string::npos ||
                text.find("no such interface") != std::string::npos)
        << text;
  }
}

}  // namespace
}  // namespace wb::can
