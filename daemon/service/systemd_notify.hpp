// Tells systemd how the daemon is doing (Type=notify, WatchdogSec). Without systemd every call does
// nothing. World: jobs (ordinary threads); never called from a step. The user links
// PkgConfig::SYSTEMD.
#pragma once
#include <systemd/sd-daemon.h>

#include <cstdint>
#include <string>

#include "core/types/time.hpp"

namespace wb::systemd {

inline void ready() { sd_notify(0, "READY=1"); }
inline void stopping() { sd_notify(0, "STOPPING=1"); }
// One line for `systemctl status`.
inline void status(const std::string& text) { sd_notify(0, ("STATUS=" + text).c_str()); }
inline void watchdog() { sd_notify(0, "WATCHDOG=1"); }

// How often to call watchdog(): a third of WatchdogSec, so that one late call does no harm; 0 if
// systemd does not watch.
inline TimeNs watchdog_period_ns() {
  std::uint64_t timeout_us = 0;
  return sd_watchdog_enabled(0, &timeout_us) > 0 ? static_cast<TimeNs>(timeout_us) * 1000 / 3 : 0;
}

}  // namespace wb::systemd
