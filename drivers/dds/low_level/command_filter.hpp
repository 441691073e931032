// What the low-level computer lets through to the joints: pure checks of a JointCommands message,
// and clipping to the joints' limits. Step world. SI units.
#pragma once
#include "drivers/dds/messages.hpp"
#include "drivers/driver.h"

namespace wb::dds {

inline constexpr TimeNs kFutureNs = 5'000'000;             // no stamp may be further ahead
inline constexpr TimeNs kValidForMaxNs = kNanosPerSecond;  // of a command

// Null, or why the command is refused. now_ns, memory_ns: on the stamps' clock; memory_ns 0: any
// age that is not before the clock's 0.
const char* refuse(const msg::JointCommands& command, const wb_description& robot, TimeNs now_ns,
                   TimeNs memory_ns) noexcept;

// The command in the limits of the joints. Call only for commands that were not refused.
void clip(const msg::JointCommands& command, const wb_description& robot,
          wb_commands& out) noexcept;

}  // namespace wb::dds
