#include "daemon/wbctl/progress.hpp"

#include <unistd.h>

#include <cmath>
#include <cstdio>

namespace wb {

Progress::Progress(bool quiet) : quiet_(quiet), terminal_(isatty(STDOUT_FILENO) == 1) {}

void Progress::show(const OperatorAck& ack, double elapsed_s) {
  if (quiet_) return;
  // A log gets a line for each phase, and one a second within it.
  if (!terminal_ && ack.phase == phase_ && elapsed_s < shown_s_ + 1.0) return;
  phase_ = ack.phase;
  shown_s_ = elapsed_s;
  const std::string& what = ack.phase == "none" ? ack.outcome : ack.phase;
  std::printf("%s%6.1f s  %-10s", terminal_ ? "\r\033[K" : "", elapsed_s, what.c_str());
  if (ack.joint_range > 0) {
    const double value = std::abs(ack.joint_value) < 5e-4 ? 0.0 : ack.joint_value;  // no "-0.000"
    std::printf("  joint at %.3f of %.3f (%.0f %%)", value, ack.joint_range,
                100 * value / ack.joint_range);
  }
  if (!terminal_) std::printf("\n");
  line_open_ = terminal_;
  std::fflush(stdout);
}

void Progress::finish() {
  if (line_open_) std::printf("\n");
  line_open_ = false;
}

}  // namespace wb
