// SDO, the state tables and the simulated drive, against the standards' own bytes and patterns.
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "drivers/can/canopen/sdo_client.hpp"
#include "drivers/can/cia402/states.hpp"
#include "drivers/can/node/cia402_node.hpp"
#include "drivers/can/node/sdo_server.hpp"

namespace wb::can {
namespace {

using Data = std::array<std::uint8_t, 8>;

// ---- SDO ---------------------------------------------------------------------------------------

Frame answer(const Data& data) {
  Frame f;
  f.id = 0x581;
  f.length = 8;
  f.data = data;
  return f;
}

TEST(Sdo, ExpeditedReadIsTheStandardsBytes) {
  SdoClient client(1, 50'000'000);
  ASSERT_TRUE(client.read(0x1018, 2));
  Frame request;
  ASSERT_TRUE(client.next_frame(0, request));
  EXPECT_EQ(request.id, 0x601u);
  EXPECT_EQ(request.data, (Data{0x40, 0x18, 0x10, 0x02}));
  client.received(answer({0x43, 0x18, 0x10, 0x02, 0x78, 0x56, 0x34, 0x12}));
  EXPECT_EQ(client.result(), SdoClient::Result::kDone);
  EXPECT_EQ(client.value(), 0x12345678u);
}

TEST(Sdo, WritesSayTheirLength) {
  const Data expected[] = {{0x2F, 0x60, 0x60, 0, 8},
                           {0x2B, 0x17, 0x10, 0, 0x64, 0},
                           {},
                           {0x23, 0x00, 0x14, 1, 0x01, 0x02, 0, 0x80}};
  const std::uint16_t index[] = {0x6060, 0x1017, 0, 0x1400};
  const std::uint32_t value[] = {8, 100, 0, 0x80000201};
  for (const int bytes : {1, 2, 4}) {
    SdoClient client(1, 50'000'000);
    const auto i = static_cast<std::size_t>(bytes - 1);
    ASSERT_TRUE(client.write(index[i], bytes == 4, bytes, value[i]));
    Frame request;
    ASSERT_TRUE(client.next_frame(0, request));
    EXPECT_EQ(request.data, expected[i]);
  }
}

TEST(Sdo, AbortEndsTheTransferWithItsCode) {
  SdoClient client(1, 50'000'000);
  Frame request;
  ASSERT_TRUE(client.read(0x1008, 0));
  ASSERT_TRUE(client.next_frame(0, request));
  client.received(answer({0x80, 0x08, 0x10, 0, 0, 0, 0x02, 0x06}));
  EXPECT_EQ(client.result(), SdoClient::Result::kAborted);
  EXPECT_EQ(client.abort_code(), SdoAbort::kNoObject);
  EXPECT_STREQ(name_of(client.abort_code()), "no such object");
}

TEST(Sdo, TimeOutAbortsAndAnAnswerOfAnotherTransferIsIgnored) {
  SdoClient client(1, 50'000'000);
  Frame request;
  ASSERT_TRUE(client.read(0x1000, 0));
  client.received(answer({0x43, 0x00, 0x10, 0, 1, 2, 3, 4}));  // before the request has left
  EXPECT_EQ(client.result(), SdoClient::Result::kBusy);
  ASSERT_TRUE(client.next_frame(0, request));
  client.received(answer({0x43, 0x18, 0x10, 1, 1, 2, 3, 4}));  // another object
  EXPECT_EQ(client.result(), SdoClient::Result::kBusy);
  EXPECT_FALSE(client.next_frame(49'999'999, request));
  ASSERT_TRUE(client.next_frame(50'000'000, request));
  EXPECT_EQ(client.result(), SdoClient::Result::kTimedOut);
  EXPECT_EQ(request.data, (Data{0x80, 0x00, 0x10, 0, 0, 0, 0x04, 0x05}));
  EXPECT_FALSE(client.next_frame(60'000'000, request));
}

TEST(Sdo, OneTransferIsUnderWayAtATime) {
  SdoClient client(1, 50'000'000);
  ASSERT_TRUE(client.read(0x1000, 0));
  EXPECT_FALSE(client.read(0x1018, 1));
  EXPECT_FALSE(client.write(0x6060, 0, 1, 8));
}

// Client and server against each other, for any length of text.
TEST(Sdo, SegmentedReadBringsTextsOfEveryLength) {
  for (int length = 1; length <= 31; ++length) {
    std::string text;
    for (int i = 0; i < length; ++i) text += static_cast<char>('a' + i % 26);
    ObjectDictionary objects;
    objects.add_text(0x1008, text);
    SdoServer server(objects, nullptr,
                     [](void*, const Object&, std::uint64_t) noexcept { return SdoAbort::kNone; });
    SdoClient client(1, 50'000'000);
    ASSERT_TRUE(client.read(0x1008, 0));
    Frame request;
    int frames = 0;
    while (client.next_frame(0, request)) {
      Data reply{};
      ASSERT_TRUE(server.answer(request.data, reply, false));
      client.received(answer(reply));
      ASSERT_LT(++frames, 20);
    }
    ASSERT_EQ(client.result(), SdoClient::Result::kDone);
    EXPECT_EQ(std::string(reinterpret_cast<const char*>(client.data()),
                          static_cast<std::size_t>(client.size())),
              text);
  }
}

TEST(Sdo, ToggleThatDoesNotAlternateEndsTheTransfer) {
  SdoClient client(1, 50'000'000);
  Frame request;
  ASSERT_TRUE(client.read(0x1008, 0));
  ASSERT_TRUE(client.next_frame(0, request));
  client.received(answer({0x41, 0x08, 0x10, 0, 20}));
  ASSERT_TRUE(client.next_frame(0, request));
  EXPECT_EQ(request.data[0], 0x60);
  client.received(answer({0x00, 'a', 'b', 'c', 'd', 'e', 'f', 'g'}));
  ASSERT_TRUE(client.next_frame(0, request));
  EXPECT_EQ(request.data[0], 0x70);
  client.received(answer({0x00, 'h', 'i', 'j', 'k', 'l', 'm', 'n'}));
  EXPECT_EQ(client.result(), SdoClient::Result::kToggle);
}

TEST(Sdo, ServerTakesSegmentedDownloads) {
  ObjectDictionary objects;
  objects.add(0x607A, 0, 4, true, 0);
  SdoServer server(objects, nullptr,
                   [](void*, const Object&, std::uint64_t) noexcept { return SdoAbort::kNone; });
  Data reply{};
  ASSERT_TRUE(server.answer({0x21, 0x7A, 0x60, 0, 4}, reply, false));
  EXPECT_EQ(reply[0], 0x60);
  ASSERT_TRUE(server.answer({0x07, 0x44, 0x33, 0x22, 0x11}, reply, false));
  EXPECT_EQ(reply[0], 0x20);
  EXPECT_EQ(objects.get(0x607A, 0), 0x11223344u);
}

// ---- state tables ------------------------------------------------------------------------------

TEST(Cia402, EveryStatuswordIsWhatThePatternsOfTheStandardSay) {
  // Bits 6 5 3 2 1 0 as in CiA 402-2, table of the statusword; x: any.
  const std::vector<std::pair<const char*, DriveState>> patterns = {
      {"0x0000", DriveState::kNotReady},         {"1x0000", DriveState::kSwitchOnDisabled},
      {"010001", DriveState::kReadyToSwitchOn},  {"010011", DriveState::kSwitchedOn},
      {"010111", DriveState::kOperationEnabled}, {"000111", DriveState::kQuickStopActive},
      {"0x1111", DriveState::kFaultReaction},    {"0x1000", DriveState::kFault}};
  constexpr int kBits[] = {6, 5, 3, 2, 1, 0};
  int unknown = 0;
  for (int word = 0; word <= 0xFFFF; ++word) {
    DriveState expected = DriveState::kUnknown;
    for (const auto& [pattern, state] : patterns) {
      bool fits = true;
      for (int i = 0; i < 6; ++i)
        fits = fits && (pattern[i] == 'x' || (pattern[i] == '1') == ((word >> kBits[i] & 1) != 0));
      if (fits) expected = state;
    }
    unknown += expected == DriveState::kUnknown;
    ASSERT_EQ(state_of(static_cast<std::uint16_t>(word)), expected) << std::hex << word;
  }
  EXPECT_GT(unknown, 0x8000) << "most patterns are in no table";
}

// ---- the simulated drive -----------------------------------------------------------------------

// A master by hand: one node, frames sent one by one.
struct NodeBench {
  explicit NodeBench(NodeOptions options = {})
      : node(options, bus, model), port(bus.attach("master")) {
    step(1'000'000);
  }
  void send(std::uint32_t id, int length, const Data& data) {
    Frame f;
    f.id = id;
    f.length = static_cast<std::uint8_t>(length);
    f.data = data;
    ASSERT_EQ(port.send(&f, 1), 1);
    step(1'000'000);
  }
  void step(TimeNs ns) {
    bus.advance(bus.now() + ns);
    std::array<Frame, 64> frames;
    for (int n; (n = port.receive(frames.data(), 64)) > 0;)
      received.insert(received.end(), frames.begin(), frames.begin() + n);
  }
  // Writes an object; the abort code, or kNone.
  SdoAbort write(std::uint16_t index, int sub, int bytes, std::uint32_t value) {
    SdoClient client(1, 50'000'000);
    EXPECT_TRUE(client.write(index, static_cast<std::uint8_t>(sub), bytes, value));
    Frame request;
    EXPECT_TRUE(client.next_frame(bus.now(), request));
    received.clear();
    send(request.id, 8, request.data);
    for (const Frame& f : received) {
      if (f.id == 0x581) client.received(f);
    }
    EXPECT_NE(client.result(), SdoClient::Result::kBusy);
    return client.abort_code();
  }
  void enable() {
    ASSERT_EQ(write(0x6060, 0, 1, 9), SdoAbort::kNone);  // csv
    for (const std::uint32_t word : {0x06u, 0x07u, 0x0Fu}) {
      ASSERT_EQ(write(0x6040, 0, 2, word), SdoAbort::kNone);
      step(10'000'000);
    }
    ASSERT_TRUE(node.enabled());
  }
  bool emergency(std::uint16_t code) const {
    for (const Frame& f : received) {
      if (f.id == 0x81 && get_bytes(f.data.data(), 2) == code) return true;
    }
    return false;
  }

  InProcessBus bus;
  IntegratorModel model;
  Cia402Node node;
  CanPort& port;
  std::vector<Frame> received;
};

TEST(Node, BootsUpPreOperationalAndAnswersResetWithAnotherBootUp) {
  NodeBench bench;
  ASSERT_EQ(bench.received.size(), 1u);
  EXPECT_EQ(bench.received[0].id, 0x701u);
  EXPECT_EQ(bench.received[0].data[0], 0);
  EXPECT_EQ(bench.node.nmt(), 0x7F);
  bench.received.clear();
  bench.send(0x000, 2, {0x81, 1});
  ASSERT_EQ(bench.received.size(), 1u);
  EXPECT_EQ(bench.received[0].id, 0x701u);
}

TEST(Node, MappingMayOnlyBeChangedWhileThePdoIsOffAndTheCountIsZero) {
  NodeBench bench;
  EXPECT_EQ(bench.write(0x1600, 0, 1, 0), SdoAbort::kUnsupportedAccess);  // PDO on
  ASSERT_EQ(bench.write(0x1400, 1, 4, 0x80000201), SdoAbort::kNone);
  EXPECT_EQ(bench.write(0x1600, 1, 4, 0x60400010), SdoAbort::kUnsupportedAccess);  // count 1
  ASSERT_EQ(bench.write(0x1600, 0, 1, 0), SdoAbort::kNone);
  EXPECT_EQ(bench.write(0x1600, 1, 4, 0x12340010), SdoAbort::kNotMappable);
  ASSERT_EQ(bench.write(0x1600, 1, 4, 0x60400010), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x1600, 2, 4, 0x60FF0020), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x1600, 3, 4, 0x607A0020), SdoAbort::kNone);
  EXPECT_EQ(bench.write(0x1600, 0, 1, 3), SdoAbort::kMappingTooLong);  // 80 bits
  EXPECT_EQ(bench.write(0x1600, 0, 1, 2), SdoAbort::kNone);
}

TEST(Node, RefusesWhatTheDictionaryDoesNotAllow) {
  NodeBench bench;
  EXPECT_EQ(bench.write(0x1018, 1, 4, 1), SdoAbort::kReadOnly);
  EXPECT_EQ(bench.write(0x2000, 0, 4, 1), SdoAbort::kNoObject);
  EXPECT_EQ(bench.write(0x1018, 9, 4, 1), SdoAbort::kNoSubindex);
  EXPECT_EQ(bench.write(0x6040, 0, 4, 1), SdoAbort::kLength);
  EXPECT_EQ(bench.write(0x6060, 0, 1, 3), SdoAbort::kRange);
}

TEST(Node, QuickStopBrakesWithItsDeceleration) {
  NodeOptions options;
  options.quick_stop_decel = 20;
  NodeBench bench(options);
  ASSERT_EQ(bench.write(0x605A, 0, 2, 6), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x60FF, 0, 4, 100'000), SdoAbort::kNone);  // 1 rad/s, by RPDO below
  bench.enable();
  bench.send(0x000, 2, {0x01, 1});
  ASSERT_EQ(bench.write(0x1400, 1, 4, 0x80000201), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x1600, 0, 1, 0), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x1600, 1, 4, 0x60400010), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x1600, 2, 4, 0x60FF0020), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x1600, 0, 1, 2), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x1400, 1, 4, 0x201), SdoAbort::kNone);
  bench.send(0x201, 6, {0x0F, 0, 0xA0, 0x86, 0x01, 0});
  EXPECT_EQ(bench.model.velocity(), 0) << "nothing before SYNC";
  bench.send(0x080, 0, {});
  bench.step(100'000'000);
  ASSERT_NEAR(bench.model.velocity(), 1.0, 1e-6);
  const double start = bench.model.position();
  bench.send(0x201, 6, {0x02, 0, 0xA0, 0x86, 0x01, 0});
  bench.send(0x080, 0, {});
  bench.step(200'000'000);
  // v^2 / (2 a) = 25 mm; before it, up to 2 ms at 1 rad/s until the SYNC.
  EXPECT_NEAR(bench.model.position() - start, 0.025, 0.003);
  EXPECT_EQ(bench.model.velocity(), 0);
  EXPECT_EQ(state_of(bench.node.statusword()), DriveState::kQuickStopActive);
}

TEST(Node, StopsByItselfWhenTheMastersHeartbeatCeases) {
  NodeBench bench;
  ASSERT_EQ(bench.write(0x1016, 1, 4, 127u << 16 | 50), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x6007, 0, 2, 3), SdoAbort::kNone);
  bench.send(0x000, 2, {0x01, 1});
  bench.enable();
  bench.step(200'000'000);
  EXPECT_TRUE(bench.node.enabled()) << "the consumer starts with the first beat";
  bench.send(0x77F, 1, {5});
  bench.step(40'000'000);
  bench.send(0x77F, 1, {5});
  bench.step(40'000'000);
  EXPECT_TRUE(bench.node.enabled());
  bench.received.clear();
  bench.step(60'000'000);
  EXPECT_FALSE(bench.node.enabled());
  EXPECT_EQ(bench.node.nmt(), 0x7F);
  EXPECT_TRUE(bench.emergency(0x8130));
}

TEST(Node, StopsByItselfWhenRpdosCease) {
  NodeBench bench;
  ASSERT_EQ(bench.write(0x1400, 5, 2, 30), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x6007, 0, 2, 3), SdoAbort::kNone);
  bench.send(0x000, 2, {0x01, 1});
  bench.enable();
  bench.send(0x201, 2, {0x0F, 0});  // the default mapping: controlword only
  bench.step(20'000'000);
  EXPECT_TRUE(bench.node.enabled());
  bench.received.clear();
  bench.step(20'000'000);
  EXPECT_FALSE(bench.node.enabled());
  EXPECT_TRUE(bench.emergency(0x8250));
}

TEST(Node, FaultClearsOnARisingEdgeOnly) {
  NodeBench bench;
  ASSERT_EQ(bench.write(0x6040, 0, 2, 0x80), SdoAbort::kNone);
  bench.node.raise(0x2310);
  bench.step(1'000'000);
  ASSERT_EQ(state_of(bench.node.statusword()), DriveState::kFault);
  ASSERT_EQ(bench.write(0x6040, 0, 2, 0x80), SdoAbort::kNone);  // still high: no edge
  EXPECT_EQ(state_of(bench.node.statusword()), DriveState::kFault);
  ASSERT_EQ(bench.write(0x6040, 0, 2, 0x00), SdoAbort::kNone);
  ASSERT_EQ(bench.write(0x6040, 0, 2, 0x80), SdoAbort::kNone);
  EXPECT_EQ(state_of(bench.node.statusword()), DriveState::kSwitchOnDisabled);
}

}  // namespace
}  // namespace wb::can
