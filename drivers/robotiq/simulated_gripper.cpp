#include "drivers/robotiq/simulated_gripper.hpp"

#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <memory>
#include <stdexcept>

namespace wb::robotiq {
namespace {

constexpr int kSlave = 9;
constexpr double kActivation_s = 0.05;  // the real one takes about two seconds
constexpr int kPass_ms = 1;             // between movements of the fingers
constexpr double kLeap_s = 0.01;        // most of one movement, however late this thread is
constexpr auto kSilence = std::chrono::milliseconds(10);
constexpr int kStart_requests = 5;  // go by before it answers after a loss of power

// CRC-16/MODBUS, bit by bit.
std::uint16_t checksum(const std::uint8_t* data, std::size_t n) {
  std::uint16_t crc = 0xFFFF;
  for (std::size_t i = 0; i < n; ++i) {
    crc ^= data[i];
    for (int bit = 0; bit < 8; ++bit)
      crc = static_cast<std::uint16_t>(crc & 1 ? (crc >> 1) ^ 0xA001 : crc >> 1);
  }
  return crc;
}

unsigned word(const std::vector<std::uint8_t>& b, std::size_t at) { return b[at] << 8 | b[at + 1]; }
void put(std::vector<std::uint8_t>& b, unsigned value) {
  b.push_back(static_cast<std::uint8_t>(value >> 8));
  b.push_back(static_cast<std::uint8_t>(value));
}

// Length of the frame that these first bytes begin; 0: more bytes are needed to tell.
std::size_t frame_length(const std::vector<std::uint8_t>& b) {
  if (b.size() < 2) return 0;
  switch (b[1]) {
    case 0x10:
      return b.size() < 7 ? 0 : 9u + b[6];
    case 0x17:
      return b.size() < 11 ? 0 : 13u + b[10];
    default:
      return 8;
  }
}

}  // namespace

Mechanics fingers_around(const std::atomic<double>& object_m, double opening_max_m) {
  return [&object_m, opening = opening_max_m](const FingerOrder& order, double dt_s) mutable {
    if (!order.move) return Fingers{opening, false};
    const double travel = order.speed_mps * dt_s;
    double next = opening + std::clamp(order.opening_m - opening, -travel, travel);
    const double object = object_m;
    const bool blocked = order.opening_m < object && opening >= object && next <= object;
    opening = blocked ? object : next;
    return Fingers{opening, blocked};
  };
}

SimulatedGripper::SimulatedGripper(std::filesystem::path port, Stroke stroke, Mechanics mechanics)
    : port_(std::move(port)), stroke_(stroke), mechanics_(std::move(mechanics)) {
  open();
  thread_ = std::thread([this] { run(); });
}

SimulatedGripper::~SimulatedGripper() {
  stopping_ = true;
  thread_.join();
  close();
}

void SimulatedGripper::open() {
  master_ = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  char name[64];
  if (master_ < 0 || grantpt(master_) != 0 || unlockpt(master_) != 0 ||
      ptsname_r(master_, name, sizeof name) != 0) {
    throw std::runtime_error(std::string("simulated gripper: no pseudo-terminal: ") +
                             std::strerror(errno));
  }
  termios raw{};
  tcgetattr(master_, &raw);
  cfmakeraw(&raw);
  tcsetattr(master_, TCSANOW, &raw);
  std::error_code error;
  std::filesystem::remove(port_, error);
  std::filesystem::create_symlink(name, port_, error);
  if (error)
    throw std::runtime_error("simulated gripper: " + port_.string() + ": " + error.message());
}

void SimulatedGripper::close() {
  if (master_ < 0) return;
  ::close(master_);
  master_ = -1;
  std::error_code error;
  std::filesystem::remove(port_, error);
}

void SimulatedGripper::unplug() { plugged_ = false; }
void SimulatedGripper::plug_in() { plugged_ = true; }

Order SimulatedGripper::order() const {
  const std::lock_guard lock(mutex_);
  return Order::decode(written_);
}

Status SimulatedGripper::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

void SimulatedGripper::run() {
  auto last = std::chrono::steady_clock::now();
  while (!stopping_) {
    if (plugged_ && master_ < 0) open();
    if (!plugged_ && master_ >= 0) close();
    pollfd p{master_, POLLIN, 0};
    poll(&p, 1, kPass_ms);
    const auto now = std::chrono::steady_clock::now();
    move(std::min(kLeap_s, std::chrono::duration<double>(now - last).count()));
    last = now;
    if (p.revents & POLLIN) {
      serve();
    } else if (p.revents & POLLHUP) {
      usleep(1000 * kPass_ms);  // nobody has the port open
    }
  }
}

void SimulatedGripper::serve() {
  std::uint8_t buffer[256];
  const ssize_t n = read(master_, buffer, sizeof buffer);
  if (n <= 0) return;
  // A silence ends a frame: what is left of a broken one must not swallow those that follow.
  const auto now = std::chrono::steady_clock::now();
  if (now - heard_ > kSilence) received_.clear();
  heard_ = now;
  received_.insert(received_.end(), buffer, buffer + n);
  for (;;) {
    const std::size_t length = frame_length(received_);
    if (length == 0 || received_.size() < length) return;
    const Bytes request(received_.begin(), received_.begin() + static_cast<long>(length));
    if (checksum(request.data(), length - 2) != (request[length - 1] << 8 | request[length - 2])) {
      received_.clear();  // as a silence on the line would: wait for the next frame
      return;
    }
    received_.erase(received_.begin(), received_.begin() + static_cast<long>(length));
    if (request[0] != kSlave) continue;
    if (starting_ > 0) {
      --starting_;
      continue;
    }
    ++requests_;
    Bytes reply = answer(request);
    if (silent_) continue;
    std::uint16_t crc = checksum(reply.data(), reply.size());
    if (spoilt_ > 0) {
      --spoilt_;
      crc ^= 0x0100;
    }
    reply.push_back(static_cast<std::uint8_t>(crc));
    reply.push_back(static_cast<std::uint8_t>(crc >> 8));
    (void)!write(master_, reply.data(), reply.size());
  }
}

SimulatedGripper::Bytes SimulatedGripper::answer(const Bytes& r) {
  const std::lock_guard lock(mutex_);
  const unsigned function = r[1], address = word(r, 2), count = word(r, 4);
  const auto refuse = [&](unsigned code) {
    return Bytes{r[0], static_cast<std::uint8_t>(function | 0x80), static_cast<std::uint8_t>(code)};
  };
  const auto read_status = [&](unsigned first, unsigned n) {
    if (first < kStatusAddress || n == 0 || first + n > kStatusAddress + kRegisters)
      return refuse(2);
    Bytes out{r[0], r[1], static_cast<std::uint8_t>(2 * n)};
    const Registers in = status_.encode();
    for (unsigned i = 0; i < n; ++i) put(out, in[first - kStatusAddress + i]);
    return out;
  };
  const auto write_order = [&](unsigned first, unsigned n, std::size_t at) {
    if (first < kOrderAddress || n == 0 || first + n > kOrderAddress + kRegisters) return false;
    for (unsigned i = 0; i < n; ++i)
      written_[first - kOrderAddress + i] = static_cast<std::uint16_t>(word(r, at + 2 * i));
    return true;
  };
  switch (function) {
    case 0x03:
    case 0x04:
      return read_status(address, count);
    case 0x06:
      return write_order(address, 1, 4) ? Bytes(r.begin(), r.begin() + 6) : refuse(2);
    case 0x10:
      return write_order(address, count, 7) ? Bytes(r.begin(), r.begin() + 6) : refuse(2);
    case 0x17:
      return write_order(word(r, 6), word(r, 8), 11) ? read_status(address, count) : refuse(2);
    default:
      return refuse(1);
  }
}

void SimulatedGripper::move(double dt_s) {
  const std::lock_guard lock(mutex_);
  if (power_cycles_.exchange(false)) {
    written_ = {};
    fault_ = 0;
    starting_ = kStart_requests;
  }
  const Order order = Order::decode(written_);
  if (!order.activate) {
    fault_ = 0;
    status_.activation = Activation::kReset;
    activating_s_ = 0;
  } else if (status_.activation == Activation::kReset) {
    status_.activation = Activation::kRunning;
    ++activations_;
  }
  FingerOrder fingers;
  if (status_.activation == Activation::kRunning) {
    // The real one opens, closes and opens again to learn its stroke.
    fingers = {stroke_.opening_max_m, kSpeedMax_mps, kForceMin_n, true};
    activating_s_ += dt_s;
    if (activating_s_ >= kActivation_s) status_.activation = Activation::kDone;
  } else if (status_.activation == Activation::kDone && order.go && fault_ == 0) {
    fingers = {opening_m(order.position, stroke_), speed_mps(order.speed),
               robotiq::force_n(order.force), true};
  }
  const Fingers f = mechanics_(fingers, dt_s);
  status_.active = order.activate;
  status_.going = order.go;
  status_.fault = fault_;
  status_.position_echo = order.position;
  status_.position = position_counts(f.opening_m, stroke_);
  const int ahead = order.position - status_.position;  // positive: closing
  status_.motion = f.blocked && ahead > 0   ? Motion::kObjectClosing
                   : f.blocked && ahead < 0 ? Motion::kObjectOpening
                   : std::abs(ahead) <= 1   ? Motion::kThere
                                            : Motion::kMoving;
  status_.current = f.blocked ? 20 : status_.motion == Motion::kMoving ? 10 : 0;
}

}  // namespace wb::robotiq
