// The CAN plugin on the kernel's SocketCAN: rows of the fault list (docs/how-to/can.md) that need a
// real network device. tests/vm/guest_can.sh has made their interfaces, the vxcan pair vxa-vxb.
// Runs in the guest of tests/vm/run.
#include "tests/vm/socketcan_fixture.hpp"

namespace wb::can {
namespace {

constexpr int kDrives = 6;

class SocketCan : public ::testing::Test {
 protected:
  void SetUp() override {
    mlockall(MCL_CURRENT | MCL_FUTURE);
    raise_priority(pthread_self(), 70);
    restore();
  }
  void TearDown() override { restore(); }
  void restore() {
    for (const char* i : {"vxa", "vxb"}) {
      (void)!std::system((std::string("tc qdisc del dev ") + i + " root 2>/dev/null").c_str());
      shell(std::string("ip link set ") + i + " up");
    }
  }
  // What happens to the frames that leave an interface.
  static void netem(const std::string& interface, const std::string& what) {
    shell("tc qdisc replace dev " + interface + " root netem " + what);
  }
};

TEST_F(SocketCan, SixDrivesAt400HzOnOneMegabitLoseNoCycle) {
  const char* seconds = std::getenv("WB_VM_SECONDS");
  const double duration_s = seconds ? std::atof(seconds) : 5;
  // 136 bit for a frame of 8 bytes: what the wire takes at worst. A pair has a medium for each
  // direction, a bus one for both; the plugin's own figure of the load counts both.
  for (const char* i : {"vxa", "vxb"}) netem(i, "rate 1mbit 1 limit 200");
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
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
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  netem("vxb", "loss 1%");
  master.run(3);
  EXPECT_GT(master.count("tpdo_missed"), 0u);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
}

TEST_F(SocketCan, SilentBusStopsEverythingAndNothingMovesWhenItIsBack) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  netem("vxb", "loss 100%");
  master.run(0.1);
  EXPECT_TRUE(master.none_follows());
  EXPECT_GT(master.count("tpdo_lost"), 0u);
  shell("tc qdisc del dev vxb root");
  master.run(0.2);
  const std::uint64_t followed = drives.followed();
  master.run(0.5);
  EXPECT_EQ(drives.followed(), followed);
  EXPECT_TRUE(master.none_follows());
  EXPECT_TRUE(master.activate()) << master.log();
}

TEST_F(SocketCan, DoubledAnswersAreTakenForTwoNodes) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  netem("vxb", "duplicate 100%");
  master.run(0.2);
  EXPECT_GT(master.count("tpdo_duplicate"), 0u);
  EXPECT_TRUE(master.none_follows());
}

TEST_F(SocketCan, FullTransmitQueueRefusesFramesAndStops) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  netem("vxa", "rate 20kbit limit 5");  // a cycle has 7 frames
  master.run(0.2);
  EXPECT_GT(master.count("frames_refused"), 0u);
  EXPECT_TRUE(master.none_follows());
  // What still waited in the kernel comes out now; nobody may follow it.
  shell("tc qdisc del dev vxa root");
  master.run(0.2);
  const std::uint64_t followed = drives.followed();
  master.run(0.3);
  EXPECT_EQ(drives.followed(), followed);
  EXPECT_TRUE(master.activate()) << master.log();
}

TEST_F(SocketCan, ForeignTrafficIsCountedAndStopsNothing) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
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
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  Stranger("vxb").send(0x181, {1, 2, 3});
  master.run(0.05);
  EXPECT_EQ(master.count("pdo_length"), 1u);
}

TEST_F(SocketCan, ErrorPassiveIsCountedAndStopsNothing) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  Stranger("vxb").send(CAN_ERR_FLAG | 0x04, {0, 0x30, 0, 0, 0, 0, 0, 0});
  master.run(0.1);
  EXPECT_GT(master.count("error_passive"), 0u);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
}

TEST_F(SocketCan, BusOffStopsAndOnlyAnActivationStartsAgain) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  const Stranger stranger("vxb");
  stranger.send(CAN_ERR_FLAG | 0x40, {0, 0, 0, 0, 0, 0, 0, 0});
  master.run(0.1);
  EXPECT_GT(master.count("bus_off"), 0u);
  EXPECT_TRUE(master.none_follows());
  stranger.send(CAN_ERR_FLAG | 0x100, {0, 0, 0, 0, 0, 0, 0, 0});  // controller restarted
  master.run(0.3);
  EXPECT_TRUE(master.none_follows());
  EXPECT_TRUE(master.activate()) << master.log();
}

TEST_F(SocketCan, FloodOfErrorFramesDoesNotStarveTheCycle) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
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

TEST_F(SocketCan, InterfaceDownStopsAndComesBackByItself) {
  Drives drives("vxb", 1, kDrives);
  Master master(config(kDrives));
  ASSERT_TRUE(master.start()) << master.log();
  shell("ip link set vxa down");
  master.run(0.1);
  EXPECT_GT(master.count("link_down"), 0u);
  EXPECT_TRUE(master.none_follows());
  shell("ip link set vxa up");
  master.run(0.3);
  EXPECT_GT(master.count("link_back"), 0u);
  EXPECT_TRUE(master.none_follows());
  EXPECT_TRUE(master.activate()) << master.log();
}

}  // namespace
}  // namespace wb::can
