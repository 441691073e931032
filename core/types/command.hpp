// Commands to the drives. Only CommandGate makes a SafeCommand, and a driver accepts nothing else.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"
#include "core/types/mode.hpp"
#include "core/types/time.hpp"

namespace wb {

enum class CommandKind : std::uint8_t {
  kNone,       // no torque request: the plugin holds its time-out action
  kImpedance,  // tau = stiffness (position - q) + damping (velocity - dq) + torque, clipped to the
               // joint's limit
  kVelocity,   // velocity servo (wheels)
};

struct JointCommand {
  CommandKind kind = CommandKind::kNone;
  double position = 0;   // rad or m
  double velocity = 0;   // rad/s or m/s
  double torque = 0;     // feed-forward, Nm or N
  double stiffness = 0;  // Nm/rad
  double damping = 0;    // Nms/rad
};

struct GripperCommand {
  double opening_m = 0;  // target of the total opening
  double force_n = 0;    // largest force per finger
};

// A request to the gate: joints in robot.yaml's order.
struct Command {
  TimeNs t_ns = 0;
  int joint_count = 0;
  int wheel_count = 0;
  std::array<JointCommand, kMaxJoints> joints{};
  std::array<JointCommand, kMaxWheels> wheels{};
  GripperCommand gripper{};
};

enum class GateReason : std::uint8_t {
  kNone,       // passed unchanged
  kScaled,     // scaled along its path into the velocity or acceleration limits
  kClipped,    // position or torque clipped into its limits
  kNotFinite,  // fallback: the request held a NaN or infinity
  kStale,      // fallback: the request was older than its memory
  kWrongSize,  // fallback: joint counts differ from the robot's
  kMode,       // fallback: the mode does not allow motion
};

class SafeCommand {
 public:
  SafeCommand() = default;  // the empty command: kind kNone everywhere, moves nothing
  const Command& get() const { return command_; }
  GateReason reason() const { return reason_; }

 private:
  friend class CommandGate;
  Command command_{};
  GateReason reason_ = GateReason::kMode;
};

}  // namespace wb
