// Time that the host gave to other machines, in ticks of 10 ms since boot, all processors together.
// Setup world.
#pragma once
#include <fstream>
#include <string>

namespace wb {

inline long steal_ticks() {
  std::ifstream in("/proc/stat");
  std::string cpu;
  long value = 0;
  in >> cpu;
  for (int i = 0; i < 8; ++i) in >> value;  // user nice system idle iowait irq softirq steal
  return value;
}

}  // namespace wb
