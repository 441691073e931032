// The CAN plugin on the kernel's SocketCAN: rows of the fault list (docs/how-to/can.md) that need a
// real network device: frames and queues. Runs in the guest of tests/vm/run.
#include "tests/vm/socketcan_fixture.hpp"

namespace wb::can {
namespace {

TEST_F(SocketCan, SixDrivesAt400HzOnOneMegabitLoseNoCycle) {
  const char* seconds = std::getenv("WB_VM_SECONDS");
  const double duration_s = seconds ? std::atof(seconds) : 60;
  // 136 bit for a frame of 8 bytes: what the wire takes at worst. A pair has a medium for each
  // direction, a bus one for both; the plugin's own figure of the load counts both.
  for (const char* i : {"vxa", "vxb"}) shell(netem(i, "rate 1mbit 1 limit 200"));
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  const std::uint64_t cycles = master.count("cycles"), missed = master.count("tpdo_missed"),
                      late = master.count("tpdo_late"), refused = master.count("frames_refused"),
                      followed = drives.followed();
  master.run(duration_s);
  const std::uint64_t n = master.count("cycles") - cycles;
  std::printf(
      "6 drives, 400 Hz, 1 Mbit/s: %llu cycles in %.0f s; TPDOs missed %llu, late %llu; "
      "frames refused %llu; RPDOs followed %llu of %llu\n",
      static_cast<unsigned long long>(n), duration_s,
      static_cast<unsigned long long>(master.count("tpdo_missed") - missed),
      static_cast<unsigned long long>(master.count("tpdo_late") - late),
      static_cast<unsigned long long>(master.count("frames_refused") - refused),
      static_cast<unsigned long long>(drives.followed() - followed),
      static_cast<unsigned long long>(kDrives * n));
  EXPECT_EQ(master.count("tpdo_missed"), missed);
  EXPECT_EQ(master.count("tpdo_late"), late);
  EXPECT_EQ(master.count("frames_refused"), refused);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
}

TEST_F(SocketCan, LossOfOnePercentIsCountedAndStopsNothing) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  shell(netem("vxb", "loss 1%"));
  master.run(3);
  EXPECT_GT(master.count("tpdo_missed"), 0u);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
}

TEST_F(SocketCan, SilentBusStopsEverythingAndNothingMovesWhenItIsBack) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  expect_stop(master, {&drives}, {netem("vxb", "loss 100%"), no_netem("vxb"), {"tpdo_lost"}});
}

TEST_F(SocketCan, DoubledAnswersAreTakenForTwoNodes) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  expect_stop(
      master, {&drives},
      {netem("vxb", "duplicate 100%"), no_netem("vxb"), {"tpdo_duplicate", "duplicate_node"}});
}

TEST_F(SocketCan, LateAnswersCountAsLateAndNeverAsFresh) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  // The window is 2 ms; with what the drives take, the answers come between it and the next SYNC.
  expect_stop(master, {&drives},
              {netem("vxb", "delay 1900us"), no_netem("vxb"), {"tpdo_late", "tpdo_lost"}, [&] {
                 const std::uint64_t cycles = master.count("cycles"),
                                     late = master.count("tpdo_late"),
                                     missed = master.count("tpdo_missed");
                 master.run(0.5);
                 const std::uint64_t n = master.count("cycles") - cycles;
                 EXPECT_GT(n, 100u);
                 // Every one of them came, and none was taken; a cycle may be under way at either
                 // end.
                 for (const std::uint64_t counted :
                      {master.count("tpdo_late") - late, master.count("tpdo_missed") - missed}) {
                   EXPECT_GE(counted, (n - 1) * kDrives) << master.log();
                   EXPECT_LE(counted, (n + 1) * kDrives) << master.log();
                 }
                 EXPECT_TRUE(master.all(WB_JOINT_LOST));
               }});
}

TEST_F(SocketCan, FullTransmitQueueRefusesFramesAndStops) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  // A cycle has 7 frames. What still waits in the kernel comes out when the limit is gone.
  expect_stop(master, {&drives},
              {netem("vxa", "rate 20kbit limit 5"), no_netem("vxa"), {"frames_refused"}});
}

// The kernel stamps received frames with CLOCK_REALTIME.
TEST_F(SocketCan, StepOfTheClockStopsNothing) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  for (const time_t step : {3600, -7200, 3600}) {
    const std::uint64_t late = master.count("tpdo_late");
    timespec t;
    ASSERT_EQ(clock_gettime(CLOCK_REALTIME, &t), 0);
    t.tv_sec += step;
    ASSERT_EQ(clock_settime(CLOCK_REALTIME, &t), 0);
    master.run(0.5);
    // At most what had been received and not yet taken.
    EXPECT_LE(master.count("tpdo_late") - late, static_cast<std::uint64_t>(kDrives));
    EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
  }
}

TEST_F(SocketCan, ForeignTrafficIsCountedAndStopsNothing) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  const Stranger stranger("vxb");
  for (int i = 0; i < 20; ++i) {
    stranger.send(0x555, {1, 2, 3, 4, 5, 6, 7, 8}, 50);
    master.run(0.02);
  }
  EXPECT_GE(master.count("foreign_frame"), 900u);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
}

TEST_F(SocketCan, ShortAnswersAreRefused) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  Stranger("vxb").send(0x181, {1, 2, 3});
  master.run(0.05);
  EXPECT_EQ(master.count("pdo_length"), 1u);
}

TEST_F(SocketCan, ErrorPassiveIsCountedAndStopsNothing) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  Stranger("vxb").send(CAN_ERR_FLAG | 0x04, {0, 0x30, 0, 0, 0, 0, 0, 0});
  master.run(0.1);
  EXPECT_GT(master.count("error_passive"), 0u);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
}

TEST_F(SocketCan, BusOffStopsAndOnlyAnActivationStartsAgain) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  const Stranger stranger("vxb");
  stranger.send(CAN_ERR_FLAG | 0x40, {0, 0, 0, 0, 0, 0, 0, 0});
  master.run(0.1);
  EXPECT_GT(master.count("bus_off"), 0u);
  EXPECT_TRUE(master.none_follows());
  const std::uint64_t followed = drives.followed();
  stranger.send(CAN_ERR_FLAG | 0x100, {0, 0, 0, 0, 0, 0, 0, 0});  // controller restarted
  master.run(1);
  EXPECT_EQ(drives.followed(), followed);
  EXPECT_TRUE(master.stopped());
  EXPECT_TRUE(master.none_follows());
  EXPECT_TRUE(master.activate()) << master.log();
}

TEST_F(SocketCan, FloodOfErrorFramesDoesNotStarveTheCycle) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  const Stranger stranger("vxb");
  const std::uint64_t cycles = master.count("cycles");
  for (int i = 0; i < 20; ++i) {
    stranger.send(CAN_ERR_FLAG | 0x80, {0, 0, 0, 0, 0, 0, 0, 0}, 100);
    master.run(0.02);
  }
  EXPECT_GT(master.count("error_frames"), 1000u);
  EXPECT_GE(master.count("cycles") - cycles, 160u);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
}

}  // namespace
}  // namespace wb::can
