// SocketCanPort: a CanPort on the kernel's SocketCAN (CAN_RAW). Port world: sendmmsg and recvmmsg
// with MSG_DONTWAIT, stamps by SO_TIMESTAMPNS brought to CLOCK_MONOTONIC, error frames by
// CAN_RAW_ERR_FILTER. Frames are refused while more than about a cycle's still wait in the kernel
// (SO_MEMINFO), so that they cannot grow old there; ENOBUFS and EAGAIN refuse, too. The
// kernel cannot take queued frames back: flush() reports them, and a drive that has lost its master
// meanwhile is pre-operational and ignores them. Bus-off: with restart-ms the kernel comes back by
// itself, without it the port stays kBusOff. An interface that went away is looked for by name.
#pragma once
#include <array>
#include <memory>
#include <string>

#include "drivers/can/can_port.hpp"

namespace wb::can {

class SocketCanPort final : public CanPort {
 public:
  // Setup: throws std::runtime_error naming interface and cause (no CAN in this kernel, no such
  // interface, interface down, another bit rate than `bit_rate` where the interface tells one).
  SocketCanPort(const std::string& interface, double bit_rate);
  ~SocketCanPort() override;

  int send(const Frame* frames, int count) RT_SAFE override;
  int receive(Frame* frames, int capacity) RT_SAFE override;
  void flush() RT_SAFE override;
  PortStatus status() RT_SAFE override { return status_; }
  int file() const RT_SAFE override { return socket_; }
  bool reopen() RT_SAFE override;

  int index() const { return index_; }  // of the interface; another one after a re-plug
  // Bytes that the kernel still holds for sending; -1 where it does not say.
  int queued_bytes() const RT_SAFE;

 private:
  struct Batch;                // sendmmsg and recvmmsg arrays
  const char* open() RT_SAFE;  // null, or what failed (errno)
  void close() RT_SAFE;
  void take_error(std::uint32_t error_class, const std::uint8_t* data) RT_SAFE;
  void lost_link(int error) RT_SAFE;
  void refresh_link() RT_SAFE;

  std::string interface_;
  int socket_ = -1, index_ = 0;
  PortStatus status_;
  std::uint32_t kernel_drops_ = 0;
  std::unique_ptr<Batch> batch_;
};

}  // namespace wb::can
