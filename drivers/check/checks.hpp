// The checks of the suite by name. Each runs alone in its process; it returns what it measured
// (may be empty), or throws Failed or Skipped.
#pragma once
#include <string>
#include <vector>

#include "drivers/check/session.hpp"

namespace wb::check {

struct Check {
  const char* name;
  const char* proves;
  std::string (*run)(const Options&);
};

// Runs it in a process of its own, which then ends without any further call.
Result in_child(const Check& check, const Options& options);

std::vector<Check> interface_checks();  // symbol, create, describe, states, extensions
std::vector<Check> reading_checks();    // samples, stamps, status, frames
std::vector<Check> motion_checks();     // first write, time-out, stop, refused commands
std::vector<Check> port_checks();       // allocations, log lines

}  // namespace wb::check
