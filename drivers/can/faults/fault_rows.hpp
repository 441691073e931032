// The fault suite: one list of faults, each with how it is injected, how soon it must be noticed,
// what the driver then does, and how one gets out of it. tests/drivers/can and bench/faults run it;
// docs/how-to/can.md shows it. Numbers are those of the fault list in the how-to. Setup world.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "drivers/can/faults/rig.hpp"

namespace wb::can {

enum class Reaction {
  kStop,      // all drives stop, latched until activate
  kGoOn,      // counted and logged, nothing stops
  kRefuse,    // configure fails, no drive is enabled
  kNoEnable,  // activate ends in the latch, no drive ever follows
};

struct FaultRow {
  std::string number;  // "17a": the list's number, and a letter where there are several
  const char* fault;
  const char* injection;
  Reaction reaction;
  std::vector<Event> events;  // the first of these that stops (or counts) is the detection
  double bound_ms;            // virtual time from injection to detection
  const char* recovery;
  std::function<void(Rig&)> inject;
  std::function<void(Rig&)> repair;
  RigOptions options = {};
  // What else must hold: kStop: right after the injection; kGoOn: at the end.
  std::function<bool(Rig&)> holds = {};
};

struct FaultResult {
  bool detected = false, reacted = false, latched = false, recovered = false, logged = false,
       counted = false;
  double detection_ms = 0;
  double moved_rad = 0;  // largest motion of a joint after the stop
  std::string event;     // what detected it
  std::string note;      // what went wrong
  bool passed() const { return detected && reacted && latched && recovered && logged && counted; }
};

const std::vector<FaultRow>& fault_rows();
FaultResult run_fault(const FaultRow& row);

// Faults of the list that an in-process bus cannot carry, and why.
struct NotCovered {
  int number;
  const char* fault;
  const char* why;
};
const std::vector<NotCovered>& faults_not_covered();

// The table of docs/how-to/can.md, in Markdown.
std::string fault_table();

}  // namespace wb::can
