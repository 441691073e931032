// A CAN bus between processes of one machine, for machines without CAN: SocketBus is the hub (an
// InProcessBus behind a Unix socket, SOCK_SEQPACKET), SocketBusPort a client's port. Drives attach
// to SocketBus::bus() in the hub's own process and answer at once; clients see the same medium, bit
// times and faults. Real time: pump(now) often, on CLOCK_MONOTONIC. Paced: the first client (the
// master) sends its frames with a tick "go on until t" and waits; the hub's owner advances bus and
// plant to requested_tick() and calls finish_tick(), which hands over every frame of that tick.
// Other clients of a paced bus listen, and their frames enter at the next tick. Hub: one thread.
#pragma once
#include <array>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "drivers/can/in_process_bus.hpp"

namespace wb::can {

// A tick of a paced bus, on two clocks: the bus's own (starts at 0 with the hub, never goes back)
// and the master's host's (the daemon's virtual time; kNoHostTime while it only sets up drives).
struct Tick {
  TimeNs bus_ns = 0;
  TimeNs host_ns = 0;
};
inline constexpr TimeNs kNoHostTime = INT64_MIN;

class SocketBus {
 public:
  // Setup: listens at `path`, replacing a stale socket there; throws std::runtime_error.
  SocketBus(const std::filesystem::path& path, bool paced, const BusOptions& options = {});
  ~SocketBus();
  InProcessBus& bus() { return bus_; }
  bool paced() const { return paced_; }
  // Clients that are connected; a paced bus stands still without one.
  int clients() const;
  int file() const { return epoll_; }  // readable when a client wants something

  // Accepts clients and takes what they sent. Real time: first advances the bus to `now`
  // (CLOCK_MONOTONIC; the bus's clock is the same), at last hands out what was delivered; call it
  // at 1 kHz or faster, it is the bus's resolution.
  void pump(TimeNs now);
  // Paced: waits at most timeout_ms for the master's tick, then pumps; nullopt: none yet.
  std::optional<Tick> requested_tick(int timeout_ms);
  // Paced: the bus stands at the requested tick (advance it there before); the master goes on.
  void finish_tick();

 private:
  struct Client;
  void accept_clients();
  bool take(Client& client);  // false: it has gone
  void hand_out(Client& client, bool end_of_tick);

  InProcessBus bus_;
  std::filesystem::path path_;
  bool paced_;
  int listener_ = -1, epoll_ = -1;
  std::vector<std::unique_ptr<Client>> clients_;
  std::optional<Tick> tick_;
};

class SocketBusPort final : public CanPort {
 public:
  // Setup: connects; throws std::runtime_error naming the path. `paced` must be what the hub is.
  SocketBusPort(const std::filesystem::path& path, bool paced);
  ~SocketBusPort() override;

  int send(const Frame* frames, int count) RT_SAFE override;
  int receive(Frame* frames, int capacity) RT_SAFE override;
  void flush() RT_SAFE override;
  PortStatus status() RT_SAFE override;
  int file() const RT_SAFE override { return socket_; }
  bool reopen() RT_SAFE override;

  // The bus's time when this client connected, later that of the last tick.
  TimeNs bus_time() const { return bus_time_; }
  // Paced: hands over what was sent and waits until the bus has run to `tick`; false after
  // timeout_ms, or if the hub has gone (then status() says so).
  bool advance(const Tick& tick, int timeout_ms) RT_SAFE;
  // The two halves of advance(), for a master of several buses: all begin, then all end, so that
  // they share one tick.
  bool begin_tick(const Tick& tick) RT_SAFE;
  bool end_tick(int timeout_ms) RT_SAFE;

 private:
  static constexpr int kReceive = 4096;
  bool take_packet(bool wait, TimeNs deadline) RT_SAFE;
  void lose() RT_SAFE;

  std::filesystem::path path_;
  bool paced_;
  int socket_ = -1;
  TimeNs bus_time_ = 0;
  bool tick_ended_ = false;
  PortStatus status_;
  std::vector<Frame> out_;  // paced: until the tick
  std::vector<Frame> in_;   // ring
  std::size_t head_ = 0, tail_ = 0;
};

}  // namespace wb::can
