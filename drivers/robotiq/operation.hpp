// What the gripper is told next: activation, motion, and holding when commands cease. Step world
// (pure): decides from the newest request and the gripper's last answer. Never lets go by itself:
// the gripper is activated (which opens it) only by the first write after an activation, and
// a hold keeps what touches an object as it was.
#pragma once
#include "core/types/time.hpp"
#include "drivers/robotiq/registers.hpp"

namespace wb::robotiq {

// What the ports ask for.
struct Request {
  std::uint64_t seq = 0;
  std::uint32_t activation = 0;  // number of the activation, from 1
  TimeNs t_ns = 0;               // of the newest write
  TimeNs timeout_ns = 0;
  bool written = false;  // a write has come since the activation
  bool hold = false;     // stop() or deactivate()
  std::uint8_t position = 0, force = 0;

  bool overdue(TimeNs now) const noexcept { return written && now - t_ns > timeout_ns; }
};

class Operation {
 public:
  enum class Stage : std::uint8_t { kReading, kResetting, kActivating, kMoving, kLost };

  explicit Operation(std::uint8_t speed) : speed_(speed) {}

  // False: nothing to say, only read. `hold`: the request's commands have ceased or it asks for it.
  bool next(const Request& request, bool hold, const Status& status, Order& order) noexcept;
  // kLost: the gripper has a fault or has lost its activation; the next activation sees to it.
  Stage stage() const noexcept { return stage_; }
  std::uint32_t activation() const noexcept { return activation_; }  // the one it has begun
  double force_n() const noexcept { return robotiq::force_n(sent_.force); }

 private:
  void begin(const Status& status) noexcept;

  std::uint8_t speed_;
  Stage stage_ = Stage::kReading;
  std::uint32_t activation_ = 0;
  bool holding_ = false;
  Order sent_;
};

}  // namespace wb::robotiq
