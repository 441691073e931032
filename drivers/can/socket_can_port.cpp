#include "drivers/can/socket_can_port.hpp"

#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/sock_diag.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <stdexcept>

#include "drivers/can/link_bit_rate.hpp"

namespace wb::can {
namespace {

constexpr int kBatch = 64;
// What the kernel may still hold when the next frames are handed over: 16 frames' buffers, about a
// cycle. More means that the bus does not keep up, and frames would grow old there.
constexpr int kQueuedMax = 16 * 768;
#ifndef SO_MEMINFO
constexpr int SO_MEMINFO = 55;
#endif

TimeNs clock_ns(clockid_t id) noexcept {
  timespec t;
  clock_gettime(id, &t);
  return static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec;
}

can_frame to_kernel(const Frame& frame) noexcept {
  can_frame f{};
  f.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0u) | (frame.remote ? CAN_RTR_FLAG : 0u);
  f.can_dlc = std::min<std::uint8_t>(frame.length, CAN_MAX_DLEN);
  std::copy_n(frame.data.begin(), f.can_dlc, f.data);
  return f;
}

}  // namespace

struct SocketCanPort::Batch {
  std::array<can_frame, kBatch> frames;
  std::array<iovec, kBatch> vectors;
  std::array<mmsghdr, kBatch> headers;
  struct alignas(cmsghdr) Control {
    std::array<char, CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t))> bytes;
  };
  std::array<Control, kBatch> controls;

  void prepare(int count, bool receive) noexcept {
    for (int k = 0; k < count; ++k) {
      const auto i = static_cast<std::size_t>(k);
      vectors[i] = {&frames[i], sizeof(can_frame)};
      headers[i] = {};
      headers[i].msg_hdr.msg_iov = &vectors[i];
      headers[i].msg_hdr.msg_iovlen = 1;
      if (!receive) continue;
      headers[i].msg_hdr.msg_control = controls[i].bytes.data();
      headers[i].msg_hdr.msg_controllen = controls[i].bytes.size();
    }
  }
};

SocketCanPort::SocketCanPort(const std::string& interface, double bit_rate)
    : interface_(interface), batch_(std::make_unique<Batch>()) {
  if (const char* what = open()) {
    const int cause = errno;
    std::string text = "CAN interface " + interface + ": " + what + ": " + std::strerror(cause);
    if (cause == EAFNOSUPPORT) text += " (this kernel has no CAN: CONFIG_CAN)";
    close();
    throw std::runtime_error(text);
  }
  if (status_.state == LinkState::kDown) {
    close();
    throw std::runtime_error("CAN interface " + interface + " is down (ip link set " + interface +
                             " up)");
  }
  const auto set = link_bit_rate(index_);
  if (set && *set != static_cast<std::uint32_t>(bit_rate)) {
    close();
    throw std::runtime_error("CAN interface " + interface + " runs at " + std::to_string(*set) +
                             " bit/s, configured are " +
                             std::to_string(static_cast<std::uint32_t>(bit_rate)));
  }
}

SocketCanPort::~SocketCanPort() { close(); }

void SocketCanPort::close() RT_SAFE {
  if (socket_ >= 0) ::close(socket_);
  socket_ = -1;
}

const char* SocketCanPort::open() RT_SAFE {
  close();
  socket_ = ::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
  if (socket_ < 0) return "no CAN socket";
  ifreq request{};
  std::strncpy(request.ifr_name, interface_.c_str(), IFNAMSIZ - 1);
  if (::ioctl(socket_, SIOCGIFINDEX, &request) != 0) return "no such interface";
  index_ = request.ifr_ifindex;
  const can_err_mask_t errors = CAN_ERR_MASK;
  const int on = 1;
  (void)::setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
  (void)::setsockopt(socket_, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
  (void)::setsockopt(socket_, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  int bytes = 1 << 20;
  (void)::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
  bytes = 1 << 17;  // a cycle of 32 drives; queued_bytes() keeps it to one
  (void)::setsockopt(socket_, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = index_;
  if (::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
    return "cannot bind";
  kernel_drops_ = 0;
  status_.state = LinkState::kActive;
  refresh_link();
  return nullptr;
}

// Whether the interface is still there and up.
void SocketCanPort::refresh_link() RT_SAFE {
  ifreq request{};
  std::strncpy(request.ifr_name, interface_.c_str(), IFNAMSIZ - 1);
  if (::ioctl(socket_, SIOCGIFINDEX, &request) != 0 || request.ifr_ifindex != index_) {
    status_.state = LinkState::kGone;
  } else if (::ioctl(socket_, SIOCGIFFLAGS, &request) == 0 && !(request.ifr_flags & IFF_UP)) {
    status_.state = LinkState::kDown;
  }
}

bool SocketCanPort::reopen() RT_SAFE {
  // What cannot be opened is gone, also if it was only down before.
  if (open() != nullptr) status_.state = LinkState::kGone;
  return carries_frames(status_.state);
}

int SocketCanPort::queued_bytes() const RT_SAFE {
  std::array<std::uint32_t, SK_MEMINFO_VARS> memory{};
  socklen_t size = sizeof memory;
  if (::getsockopt(socket_, SOL_SOCKET, SO_MEMINFO, memory.data(), &size) != 0) return -1;
  return static_cast<int>(memory[SK_MEMINFO_WMEM_ALLOC]);
}

void SocketCanPort::lost_link(int error) RT_SAFE {
  if (error == ENETDOWN) status_.state = LinkState::kDown;
  if (error == ENODEV || error == ENXIO) status_.state = LinkState::kGone;
}

int SocketCanPort::send(const Frame* frames, int count) RT_SAFE {
  int taken = 0;
  if (socket_ >= 0 && carries_frames(status_.state) && queued_bytes() <= kQueuedMax) {
    while (taken < count) {
      const int n = std::min(count - taken, kBatch);
      for (int i = 0; i < n; ++i)
        batch_->frames[static_cast<std::size_t>(i)] = to_kernel(frames[taken + i]);
      batch_->prepare(n, false);
      const int sent = ::sendmmsg(socket_, batch_->headers.data(), static_cast<unsigned>(n),
                                  MSG_DONTWAIT | MSG_NOSIGNAL);
      if (sent < 0) {  // ENOBUFS, EAGAIN: the queue is full
        lost_link(errno);
        break;
      }
      taken += sent;
      if (sent < n) break;
    }
  }
  status_.sent += static_cast<std::uint64_t>(taken);
  status_.refused += static_cast<std::uint64_t>(count - taken);
  return taken;
}

void SocketCanPort::take_error(std::uint32_t error_class, const std::uint8_t* data) RT_SAFE {
  ++status_.error_frames;
  if (error_class & CAN_ERR_BUSOFF) {
    if (status_.state != LinkState::kBusOff) ++status_.bus_offs;
    status_.state = LinkState::kBusOff;
  } else if (error_class & CAN_ERR_RESTARTED) {
    if (status_.state == LinkState::kBusOff) ++status_.restarts;
    status_.state = LinkState::kActive;
  } else if ((error_class & CAN_ERR_CRTL) && carries_frames(status_.state)) {
    if (data[1] & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) {
      status_.state = LinkState::kPassive;
    } else if (data[1] & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) {
      status_.state = LinkState::kWarning;
    } else if (data[1] & CAN_ERR_CRTL_ACTIVE) {
      status_.state = LinkState::kActive;
    }
    if (data[1] & CAN_ERR_CRTL_RX_OVERFLOW) ++status_.overruns;
  }
}

int SocketCanPort::receive(Frame* frames, int capacity) RT_SAFE {
  if (socket_ < 0) return 0;
  int count = 0;
  // Error frames are consumed here: at most one more batch than asked for.
  for (int round = 0; round < 2 && count < capacity; ++round) {
    const int want = std::min(capacity - count, kBatch);
    batch_->prepare(want, true);
    const int n = ::recvmmsg(socket_, batch_->headers.data(), static_cast<unsigned>(want),
                             MSG_DONTWAIT, nullptr);
    if (n < 0) {
      if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) lost_link(errno);
      break;
    }
    const TimeNs to_monotonic = clock_ns(CLOCK_MONOTONIC) - clock_ns(CLOCK_REALTIME);
    for (int k = 0; k < n; ++k) {
      const auto i = static_cast<std::size_t>(k);
      const can_frame& in = batch_->frames[i];
      TimeNs stamp = clock_ns(CLOCK_MONOTONIC);
      msghdr& header = batch_->headers[i].msg_hdr;
      for (cmsghdr* c = CMSG_FIRSTHDR(&header); c != nullptr; c = CMSG_NXTHDR(&header, c)) {
        if (c->cmsg_level != SOL_SOCKET) continue;
        if (c->cmsg_type == SCM_TIMESTAMPNS) {
          timespec t;
          std::memcpy(&t, CMSG_DATA(c), sizeof t);
          const TimeNs real = static_cast<TimeNs>(t.tv_sec) * kNanosPerSecond + t.tv_nsec;
          stamp = std::min(stamp, real + to_monotonic);
        } else if (c->cmsg_type == SO_RXQ_OVFL) {
          std::uint32_t drops;
          std::memcpy(&drops, CMSG_DATA(c), sizeof drops);
          status_.overruns += drops - kernel_drops_;
          kernel_drops_ = drops;
        }
      }
      if (batch_->headers[i].msg_len != sizeof(can_frame)) continue;  // CAN FD: nobody asked for it
      if (in.can_id & CAN_ERR_FLAG) {
        take_error(in.can_id & CAN_ERR_MASK, in.data);
        continue;
      }
      Frame& out = frames[count++];
      out = {};
      out.extended = in.can_id & CAN_EFF_FLAG;
      out.remote = in.can_id & CAN_RTR_FLAG;
      out.id = in.can_id & (out.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
      out.length = std::min<std::uint8_t>(in.can_dlc, CAN_MAX_DLEN);
      std::copy_n(in.data, out.length, out.data.begin());
      out.t_ns = stamp;
    }
    if (n < want) break;
  }
  status_.received += static_cast<std::uint64_t>(count);
  return count;
}

void SocketCanPort::flush() RT_SAFE {
  // Nothing waits in user space. What the kernel holds is at most one cycle; it is counted.
  if (socket_ >= 0 && queued_bytes() > 0) ++status_.flushed;
}

}  // namespace wb::can
