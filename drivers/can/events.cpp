#include "drivers/can/events.hpp"

namespace wb::can {

const EventText& text_of(Event event) {
  static constexpr std::array<EventText, kEvents> kTexts = {{
      {"command_timeout", "no command came in time [ms]"},
      {"stop_requested", "stop was asked for"},
      {"tpdo_lost", "no fresh TPDO, cycles in a row"},
      {"heartbeat_lost", "no heartbeat for [ms]"},
      {"nmt_state", "the drive left the operational state, NMT state", true},
      {"boot_up", "the drive has rebooted"},
      {"emergency", "emergency message, code", true},
      {"drive_fault", "the drive is in fault, statusword", true},
      {"unknown_statusword", "statusword that CiA 402 does not list", true},
      {"quick_stop_active", "quick stop that nobody commanded, statusword", true},
      {"not_enabled", "the drive left operation enabled, statusword", true},
      {"mode_mismatch", "mode display differs from the mode that was set", true},
      {"internal_limit", "the drive reports its internal limit, statusword", true},
      {"following_error_bit", "the drive reports a following error, statusword", true},
      {"not_following", "the measured value does not follow the target for [ms]"},
      {"position_jump", "the measured position jumped [counts]"},
      {"position_range", "the measured position lies outside the joint's range [counts]"},
      {"duplicate_node", "two nodes have this id (two TPDOs in each cycle)"},
      {"second_master", "another master commands this bus, COB-ID", true},
      {"transmit_refused", "frames could not be sent, cycles in a row"},
      {"bus_off", "the controller is bus-off"},
      {"bus_off_limit", "too many bus-offs; the bus stays out of use until it is set up again"},
      {"link_down", "the interface is down"},
      {"link_gone", "the interface has gone"},
      {"bus_timeout", "the bus did not finish its tick"},
      {"enable_timeout", "the drive did not reach operation enabled, statusword", true},
      {"reset_limit", "the fault does not clear, attempts"},
      {"sdo_timeout", "the drive does not answer SDO", true},
      {"sdo_abort", "the drive aborts SDO, code", true},
      {"sdo_toggle", "toggle error in an SDO transfer"},
      {"identity", "the drive is not the one that was configured; it says", true},
      {"mode_unsupported", "the drive does not support the mode, supported", true},
      {"mapping_differs", "the PDO mapping read back differs from what was written", true},
      {"tpdo_missed", "a TPDO is missing"},
      {"tpdo_late", "a TPDO came after its window [us]"},
      {"tpdo_duplicate", "a TPDO came twice"},
      {"pdo_length", "a TPDO has the wrong length"},
      {"foreign_frame", "frame of nobody here, COB-ID", true},
      {"error_reset", "the drive says that its errors are gone"},
      {"command_rejected", "a command was refused (not finite, over a limit or too fast)"},
      {"command_stale", "a command was refused, too old or from the future [us]"},
      {"error_frames", "error frames"},
      {"error_passive", "the controller is error-passive"},
      {"receive_overrun", "received frames were lost"},
      {"link_back", "the bus carries frames again"},
      {"drive_ready", "drive identified and set up"},
      {"priority_refused", "the bus's thread did not get its priority"},
      {"log_dropped", "log records lost"},
  }};
  return kTexts[static_cast<std::size_t>(event)];
}

}  // namespace wb::can
