// How much a cycle of the CAN plugin costs with 18 drives (three buses of six) at 400 Hz: processor
// time of the plugin's threads and of its caller from one control tick to the next, and from the
// tick to the last drive's answer. Prints a line for each figure; tests/vm/rt compares them. Runs
// in its guest, where time counts instructions. Usage: vm_cycle_path SECONDS
// WB_VM_BURN_US: what the caller wastes in each cycle, to see the gate fail.
#include <algorithm>
#include <filesystem>
#include <fstream>

#include "tests/vm/socketcan_fixture.hpp"

namespace wb::can {
namespace {

TimeNs read_clock(clockid_t clock) {
  timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec * kNanosPerSecond + t.tv_nsec;
}

// Of the threads that the plugin named after its buses. A thread of the same process has a clock
// whose number is made of its id (pthread_getcpuclockid wants a pthread_t, which is the plugin's).
std::vector<clockid_t> bus_clocks() {
  std::vector<clockid_t> clocks;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::string name;
    std::getline(std::ifstream(task.path() / "comm"), name);
    const int id = std::stoi(task.path().filename());
    if (name.starts_with("can_")) clocks.push_back(static_cast<clockid_t>(~id << 3 | 6));
  }
  return clocks;
}

// The kernel's tick comes every 4 ms, so that it meets a cycle in one of five places, which differ
// from boot to boot. With this drift it meets all of them: 0.5 ms in 8000 cycles.
constexpr TimeNs kDrift = 63;

struct Figures {
  std::vector<TimeNs> values;
  void print(const char* name, bool median) {
    std::sort(values.begin(), values.end());
    if (median) std::printf("figure %s_p50_us %.1f\n", name, 1e-3 * values[values.size() / 2]);
    std::printf("figure %s_max_us %.1f\n", name, 1e-3 * values.back());
  }
};

int run(double seconds) {
  const char* burn_us = std::getenv("WB_VM_BURN_US");
  const TimeNs burn = burn_us ? std::atoll(burn_us) * 1000 : 0;
  mlockall(MCL_CURRENT | MCL_FUTURE);
  set_priority(pthread_self(), 79);  // above the drives, which are no part of the computer
  const Setup setup{.interfaces = {"vxa", "vxc", "vxe"}};
  Drives a("vxb", 1, setup.drives), b("vxd", 1, setup.drives), c("vxf", 1, setup.drives);
  const auto followed = [&] { return a.followed() + b.followed() + c.followed(); };
  Master master(config(setup));
  if (!master.start()) {
    std::printf("the drives do not follow\n%s", master.log().c_str());
    return 1;
  }
  master.run(1);  // what is slow the first time
  const std::vector<clockid_t> clocks = bus_clocks();
  if (clocks.size() != setup.interfaces.size()) {
    std::printf("%zu bus threads found, expected %zu\n", clocks.size(), setup.interfaces.size());
    return 1;
  }
  const auto bus_time = [&] {
    TimeNs sum = 0;
    for (const clockid_t clock : clocks) sum += read_clock(clock);
    return sum;
  };
  const char* incomplete[] = {"tpdo_missed", "tpdo_late", "frames_refused"};
  const auto losses = [&] {
    std::uint64_t n = 0;
    for (const char* i : incomplete) n += master.count(i);
    return n;
  };
  const auto cycles = static_cast<std::size_t>(seconds * 400);
  Figures wake, cycle, answers;
  for (Figures* f : {&wake, &cycle, &answers}) f->values.reserve(cycles);
  const std::uint64_t losses_before = losses(), followed_before = followed();
  TimeNs next = RealTime::monotonic(), woke = 0, buses = 0, own = 0;
  for (std::size_t i = 0; i <= cycles; ++i) {
    next += kCycle + kDrift;
    const timespec at{next / kNanosPerSecond, next % kNanosPerSecond};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
    const TimeNs last_woke = woke, last_buses = buses;
    woke = RealTime::monotonic();
    buses = bus_time();
    const TimeNs start = read_clock(CLOCK_THREAD_CPUTIME_ID);
    master.tick();
    if (i > 0) {
      wake.values.push_back(woke - next);
      cycle.values.push_back(buses - last_buses + own);
      answers.values.push_back(master.last_answer() - last_woke);
    }
    const TimeNs burnt = read_clock(CLOCK_THREAD_CPUTIME_ID) + burn;
    while (burn > 0 && read_clock(CLOCK_THREAD_CPUTIME_ID) < burnt) {
    }
    own = read_clock(CLOCK_THREAD_CPUTIME_ID) - start;
  }
  const std::uint64_t lost = losses() - losses_before, obeyed = followed() - followed_before;
  const bool all = obeyed >= 18 * cycles && master.all(WB_JOINT_FOLLOWING);
  std::printf("18 drives on 3 buses, 400 Hz: %zu cycles; %s\n", cycles,
              all ? "every RPDO followed" : "RPDOs were not followed");
  wake.print("wake", false);
  cycle.print("cycle", true);
  answers.print("answers", true);
  std::printf("figure incomplete %llu\n", static_cast<unsigned long long>(lost));
  return all ? 0 : 1;
}

}  // namespace
}  // namespace wb::can

int main(int argc, char** argv) { return wb::can::run(argc > 1 ? std::atof(argv[1]) : 10); }
