// `wbctl rt-test`: how punctually this computer wakes a 400 Hz SCHED_FIFO loop. Job world; the loop
// itself runs on a thread of its own.
#pragma once

namespace wb {

// Prints the report. 0: pass, 1: fail, 2: invalid (time was stolen).
int rt_test_main(double seconds, bool json);

}  // namespace wb
