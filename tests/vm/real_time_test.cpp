// The path length of a control cycle with 18 drives on three buses, through plugin and kernel, as
// CPU time of the master's process. In a guest whose time counts instructions (tests/vm/rt) it
// depends on nothing else that runs here: a regression gate, not a latency of silicon.
#include <sys/wait.h>

#include <ctime>

#include "tests/vm/socketcan_fixture.hpp"

namespace wb::can {
namespace {

constexpr int kBuses = 3, kDrivesPerBus = 6;
// 500 million instructions a second of guest time.
constexpr double kBound_us = WB_CYCLE_BOUND_US;

TEST(RealTimeGuest, CycleOfEighteenDrivesKeepsItsPathLength) {
  mlockall(MCL_CURRENT | MCL_FUTURE);
  const pid_t child = fork();
  if (child == 0) {
    Drives a("vxb", 1, kDrivesPerBus), c("vxd", 1, kDrivesPerBus), e("vxf", 1, kDrivesPerBus);
    pause();
    _exit(0);
  }
  raise_priority(pthread_self(), 70);
  {
    Master master(config(kDrivesPerBus, kBuses));
    ASSERT_TRUE(master.start()) << master.log();
    const auto cpu_us = [] {
      timespec t;
      clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
      return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
    };
    const std::uint64_t cycles = master.count("cycles"), missed = master.count("tpdo_missed");
    const double before_us = cpu_us();
    master.run(5);
    const double n = static_cast<double>(master.count("cycles") - cycles) / kBuses;
    const double path_us = (cpu_us() - before_us) / n;
    std::printf(
        "18 drives on 3 buses: %.0f cycles, %.0f us of CPU a cycle (bound %.0f us), TPDOs "
        "missed %llu\n",
        n, path_us, kBound_us,
        static_cast<unsigned long long>(master.count("tpdo_missed") - missed));
    EXPECT_LT(path_us, kBound_us);
    EXPECT_EQ(master.count("tpdo_missed"), missed);
    EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
  }
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
}

}  // namespace
}  // namespace wb::can
