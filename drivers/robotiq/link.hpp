// The serial line to the gripper: one exchange of registers at a time over Modbus RTU (libmodbus).
// Blocks for up to the response time-out; only the plugin's own thread calls it.
#pragma once
#include <modbus/modbus.h>

#include <memory>

#include "drivers/robotiq/robotiq_config.hpp"

namespace wb::robotiq {

enum class LinkResult { kOk, kClosed, kTimedOut, kBadChecksum, kOtherError };

class Link {
 public:
  explicit Link(const Config& config) : config_(config) {}

  // Opens the port if need be (kClosed: it cannot be), then writes the order, if there is one, and
  // reads the status. A port that has gone is closed, and opened anew at a later call.
  LinkResult exchange(const Order* order, Status& status);

 private:
  bool open();
  LinkResult fail();

  struct Close {
    void operator()(modbus_t* m) const {
      modbus_close(m);
      modbus_free(m);
    }
  };
  Config config_;
  std::unique_ptr<modbus_t, Close> modbus_;
};

}  // namespace wb::robotiq
