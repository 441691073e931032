#include "drivers/can/socket_bus.hpp"

#include <poll.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <stdexcept>

namespace wb::can {
namespace {

enum class PacketKind : std::uint32_t {
  kHello,   // hub to client: bus_ns
  kFrames,  // either way
  kTick,    // client to hub, after its frames: go on until here
  kDone,    // hub to client, after the frames of the tick
  kFlush,   // client to hub
};
constexpr std::uint32_t kMagic = 0x57424331;  // "WBC1": hub and client of one build
constexpr int kFramesPerPacket = 64;

struct Packet {
  std::uint32_t magic = kMagic;
  PacketKind kind = PacketKind::kFrames;
  std::uint32_t count = 0;
  std::uint32_t paced = 0;
  Tick tick;
  PortStatus status;
  std::array<Frame, kFramesPerPacket> frames;

  std::size_t size() const { return offsetof(Packet, frames) + count * sizeof(Frame); }
};

TimeNs monotonic() noexcept {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec;
}

sockaddr_un address_of(const std::filesystem::path& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string text = path.string();
  if (text.size() >= sizeof address.sun_path)
    throw std::runtime_error("CAN bus " + text + ": the path is too long for a socket");
  std::memcpy(address.sun_path, text.c_str(), text.size() + 1);
  return address;
}

[[noreturn]] void fail(const std::filesystem::path& path, const char* what) {
  throw std::runtime_error("CAN bus " + path.string() + ": " + what + ": " + std::strerror(errno));
}

bool transmit(int socket, const Packet& packet, int flags) noexcept {
  ssize_t n;
  do {
    n = ::send(socket, &packet, packet.size(), flags | MSG_NOSIGNAL);
  } while (n < 0 && errno == EINTR);
  return n == static_cast<ssize_t>(packet.size());
}

// 1: a packet; 0: none waits; -1: the other side has gone or speaks something else.
int take_one(int socket, Packet& packet) noexcept {
  ssize_t n;
  do {
    n = ::recv(socket, &packet, sizeof packet, MSG_DONTWAIT);
  } while (n < 0 && errno == EINTR);
  if (n < 0) return errno == EAGAIN || errno == EWOULDBLOCK ? 0 : -1;
  const bool whole = n >= static_cast<ssize_t>(offsetof(Packet, frames)) &&
                     packet.magic == kMagic && packet.count <= kFramesPerPacket &&
                     static_cast<std::size_t>(n) == packet.size();
  return whole ? 1 : -1;
}

// A tick's worth of frames fits into the socket's buffer, so that neither side waits in send().
void enlarge(int socket) noexcept {
  const int bytes = 1 << 20;
  (void)setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
}

}  // namespace

struct SocketBus::Client {
  int socket;
  CanPort* port;
};

SocketBus::SocketBus(const std::filesystem::path& path, bool paced, const BusOptions& options)
    : bus_(options), path_(path), paced_(paced) {
  const sockaddr_un address = address_of(path);
  listener_ = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  epoll_ = epoll_create1(EPOLL_CLOEXEC);
  if (listener_ < 0 || epoll_ < 0) fail(path, "no socket");
  ::unlink(address.sun_path);
  if (::bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(listener_, 8) != 0)
    fail(path, "cannot listen");
  epoll_event event{};
  event.events = EPOLLIN;
  epoll_ctl(epoll_, EPOLL_CTL_ADD, listener_, &event);
  if (!paced_) bus_.advance(monotonic());
}

SocketBus::~SocketBus() {
  for (auto& client : clients_) ::close(client->socket);
  ::close(epoll_);
  ::close(listener_);
  ::unlink(path_.c_str());
}

int SocketBus::clients() const { return static_cast<int>(clients_.size()); }

void SocketBus::accept_clients() {
  for (;;) {
    const int socket = ::accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (socket < 0) return;
    enlarge(socket);
    Packet hello;
    hello.kind = PacketKind::kHello;
    hello.paced = paced_;
    hello.tick.bus_ns = bus_.now();
    if (!transmit(socket, hello, MSG_DONTWAIT)) {
      ::close(socket);
      continue;
    }
    epoll_event event{};
    event.events = EPOLLIN;
    epoll_ctl(epoll_, EPOLL_CTL_ADD, socket, &event);
    clients_.push_back(std::make_unique<Client>(Client{socket, &bus_.attach("client")}));
  }
}

bool SocketBus::take(Client& client) {
  Packet packet;
  for (;;) {
    const int result = take_one(client.socket, packet);
    if (result <= 0) return result == 0;
    switch (packet.kind) {
      case PacketKind::kFrames:
        client.port->send(packet.frames.data(), static_cast<int>(packet.count));
        break;
      case PacketKind::kFlush:
        client.port->flush();
        break;
      case PacketKind::kTick:
        if (&client == clients_.front().get()) tick_ = packet.tick;
        break;
      case PacketKind::kHello:
      case PacketKind::kDone:
        return false;
    }
  }
}

void SocketBus::hand_out(Client& client, bool end_of_tick) {
  Packet packet;
  packet.status = client.port->status();
  // A client that doesn't read loses frames, as one with a full receive buffer does.
  for (;;) {
    packet.count =
        static_cast<std::uint32_t>(client.port->receive(packet.frames.data(), kFramesPerPacket));
    if (packet.count == 0) break;
    (void)transmit(client.socket, packet, MSG_DONTWAIT);
  }
  if (!end_of_tick) return;
  packet.kind = PacketKind::kDone;
  packet.tick = *tick_;
  (void)transmit(client.socket, packet, MSG_DONTWAIT);
}

void SocketBus::pump(TimeNs now) {
  // First up to now, then what the clients sent: a frame never gets onto the wire before its time.
  if (!paced_) bus_.advance(now);
  accept_clients();
  for (std::size_t i = 0; i < clients_.size();) {
    if (take(*clients_[i])) {
      ++i;
      continue;
    }
    if (i == 0) tick_.reset();
    bus_.detach(*clients_[i]->port);
    ::close(clients_[i]->socket);
    clients_.erase(clients_.begin() + static_cast<std::ptrdiff_t>(i));
  }
  if (paced_) return;
  for (auto& client : clients_) hand_out(*client, false);
}

std::optional<Tick> SocketBus::requested_tick(int timeout_ms) {
  pump(0);
  if (!tick_ && timeout_ms > 0) {
    epoll_event event;
    (void)epoll_wait(epoll_, &event, 1, timeout_ms);
    pump(0);
  }
  return tick_;
}

void SocketBus::finish_tick() {
  if (!tick_) return;
  for (std::size_t i = 0; i < clients_.size(); ++i) hand_out(*clients_[i], i == 0);
  tick_.reset();
}

// ---- client ------------------------------------------------------------------------------------

SocketBusPort::SocketBusPort(const std::filesystem::path& path, bool paced)
    : path_(path), paced_(paced), in_(kReceive) {
  out_.reserve(kFramesPerPacket);
  (void)address_of(path);
  if (!reopen()) fail(path, "no bus answers there (is the hub running, and paced alike?)");
}

SocketBusPort::~SocketBusPort() {
  if (socket_ >= 0) ::close(socket_);
}

bool SocketBusPort::reopen() RT_SAFE {
  constexpr int kHelloMs = 1000;
  if (socket_ >= 0) ::close(socket_);
  status_.state = LinkState::kGone;
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::strncpy(address.sun_path, path_.c_str(), sizeof address.sun_path - 1);
  socket_ = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (socket_ < 0) return false;
  enlarge(socket_);
  Packet hello;
  pollfd wait{socket_, POLLIN, 0};
  if (::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      ::poll(&wait, 1, kHelloMs) <= 0 || take_one(socket_, hello) != 1 ||
      hello.kind != PacketKind::kHello || (hello.paced != 0) != paced_) {
    const int cause = errno;
    lose();
    errno = cause;
    return false;
  }
  bus_time_ = hello.tick.bus_ns;
  head_ = tail_ = 0;
  out_.clear();
  status_.state = LinkState::kActive;
  return true;
}

void SocketBusPort::lose() RT_SAFE {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
  status_.state = LinkState::kGone;
}

int SocketBusPort::send(const Frame* frames, int count) RT_SAFE {
  int taken = 0;
  if (socket_ >= 0) {
    if (paced_) {
      while (taken < count && out_.size() < out_.capacity()) out_.push_back(frames[taken++]);
    } else {
      Packet packet;
      while (taken < count) {
        const int n = std::min(count - taken, kFramesPerPacket);
        std::copy(frames + taken, frames + taken + n, packet.frames.begin());
        packet.count = static_cast<std::uint32_t>(n);
        if (!transmit(socket_, packet, MSG_DONTWAIT)) {
          if (errno != EAGAIN && errno != EWOULDBLOCK) lose();
          break;
        }
        taken += n;
      }
    }
  }
  status_.sent += static_cast<std::uint64_t>(taken);
  status_.refused += static_cast<std::uint64_t>(count - taken);
  return taken;
}

// With `wait`, until the deadline (CLOCK_MONOTONIC); false: nothing came.
bool SocketBusPort::take_packet(bool wait, TimeNs deadline) RT_SAFE {
  if (socket_ < 0) return false;
  Packet packet;
  int result = take_one(socket_, packet);
  while (result == 0 && wait) {
    const TimeNs left = deadline - monotonic();
    if (left <= 0) return false;
    const timespec timeout{left / kNanosPerSecond, left % kNanosPerSecond};
    pollfd readable{socket_, POLLIN, 0};
    (void)::ppoll(&readable, 1, &timeout, nullptr);
    result = take_one(socket_, packet);
  }
  if (result < 0) lose();
  if (result <= 0) return false;
  if (packet.kind == PacketKind::kDone) {
    tick_ended_ = true;
    bus_time_ = packet.tick.bus_ns;
  }
  for (std::uint32_t i = 0; i < packet.count && packet.kind == PacketKind::kFrames; ++i) {
    if (tail_ - head_ == in_.size()) {
      ++status_.overruns;
    } else {
      in_[tail_++ % in_.size()] = packet.frames[i];
    }
  }
  // The hub's view of this port: link state and error counters are the simulated controller's.
  status_.state = packet.status.state;
  status_.error_frames = packet.status.error_frames;
  status_.bus_offs = packet.status.bus_offs;
  status_.restarts = packet.status.restarts;
  return true;
}

int SocketBusPort::receive(Frame* frames, int capacity) RT_SAFE {
  while (tail_ - head_ < static_cast<std::size_t>(capacity) && take_packet(false, 0)) {
  }
  int n = 0;
  while (n < capacity && head_ != tail_) frames[n++] = in_[head_++ % in_.size()];
  status_.received += static_cast<std::uint64_t>(n);
  return n;
}

void SocketBusPort::flush() RT_SAFE {
  status_.flushed += out_.size();
  out_.clear();
  Packet packet;
  packet.kind = PacketKind::kFlush;
  if (socket_ >= 0) (void)transmit(socket_, packet, MSG_DONTWAIT);
}

PortStatus SocketBusPort::status() RT_SAFE { return status_; }

bool SocketBusPort::begin_tick(const Tick& tick) RT_SAFE {
  if (socket_ < 0) return false;
  tick_ended_ = false;
  Packet packet;
  packet.count = static_cast<std::uint32_t>(out_.size());
  std::copy(out_.begin(), out_.end(), packet.frames.begin());
  out_.clear();
  Packet go;
  go.kind = PacketKind::kTick;
  go.tick = tick;
  if ((packet.count > 0 && !transmit(socket_, packet, MSG_DONTWAIT)) ||
      !transmit(socket_, go, MSG_DONTWAIT)) {
    lose();
    return false;
  }
  return true;
}

bool SocketBusPort::end_tick(int timeout_ms) RT_SAFE {
  const TimeNs deadline = monotonic() + timeout_ms * TimeNs{1'000'000};
  while (!tick_ended_) {
    if (!take_packet(true, deadline)) return false;
  }
  return true;
}

bool SocketBusPort::advance(const Tick& tick, int timeout_ms) RT_SAFE {
  return begin_tick(tick) && end_tick(timeout_ms);
}

}  // namespace wb::can
