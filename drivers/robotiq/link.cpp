#include "drivers/robotiq/link.hpp"

#include <cerrno>

namespace wb::robotiq {

bool Link::open() {
  if (modbus_) return true;
  std::unique_ptr<modbus_t, Close> m(
      modbus_new_rtu(config_.device.c_str(), config_.baud, 'N', 8, 1));
  if (!m) return false;
  const auto us = static_cast<std::uint32_t>(config_.response_timeout_ns / 1000);
  if (modbus_set_slave(m.get(), config_.slave) != 0 ||
      modbus_set_response_timeout(m.get(), us / 1'000'000, us % 1'000'000) != 0 ||
      modbus_connect(m.get()) != 0) {
    return false;
  }
  modbus_flush(m.get());
  modbus_ = std::move(m);
  return true;
}

LinkResult Link::fail() {
  const int error = errno;
  if (error == ETIMEDOUT || error == EMBBADCRC || error >= MODBUS_ENOBASE) {
    // What is left of a spoilt answer must not be taken for the next one.
    modbus_flush(modbus_.get());
    return error == ETIMEDOUT   ? LinkResult::kTimedOut
           : error == EMBBADCRC ? LinkResult::kBadChecksum
                                : LinkResult::kOtherError;
  }
  modbus_.reset();
  return LinkResult::kClosed;
}

LinkResult Link::exchange(const Order* order, Status& status) {
  if (!open()) return LinkResult::kClosed;
  Registers in{};
  int n = 0;
  if (order != nullptr) {
    const Registers out = order->encode();
    n = modbus_write_and_read_registers(modbus_.get(), kOrderAddress, kRegisters, out.data(),
                                        kStatusAddress, kRegisters, in.data());
  } else {
    n = modbus_read_registers(modbus_.get(), kStatusAddress, kRegisters, in.data());
  }
  if (n != kRegisters) return fail();
  status = Status::decode(in);
  return LinkResult::kOk;
}

}  // namespace wb::robotiq
