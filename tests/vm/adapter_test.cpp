// The CAN plugin on the kernel's SocketCAN: interfaces that go down, go away, come back as another
// one, or are wrong from the start. Runs in the guest of tests/vm/run.
#include "tests/vm/socketcan_fixture.hpp"

namespace wb::can {
namespace {

constexpr const char* kPlugIn =
    "ip link add vxa txqueuelen 256 type vxcan peer name vxb txqueuelen 256 && "
    "ip link set vxa up && ip link set vxb up";

TEST_F(SocketCan, InterfaceDownStopsAndComesBackByItself) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  expect_stop(master, {&drives}, {"ip link set vxa down", "ip link set vxa up", {"link_down"}});
  EXPECT_GT(master.count("link_back"), 0u);
}

TEST_F(SocketCan, PulledAdapterStopsAndIsFoundAgainUnderAnotherIndex) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  const unsigned index = if_nametoindex("vxa");
  expect_stop(master, {&drives}, {"ip link del vxa", kPlugIn, {"link_gone"}, [] {
                                    EXPECT_EQ(if_nametoindex("vxa"), 0u);
                                  }});
  EXPECT_NE(if_nametoindex("vxa"), index);
  EXPECT_EQ(master.count("link_gone"), 1u) << master.log();
  EXPECT_EQ(master.count("link_back"), 1u) << master.log();
}

TEST_F(SocketCan, AdapterThatGoesDownFirstIsToldAsGone) {
  Drives drives("vxb", 1, kDrives);
  Master master(config());
  ASSERT_TRUE(master.start()) << master.log();
  expect_stop(master, {&drives}, {"ip link set vxa down", kPlugIn, {"link_down", "link_gone"}, [&] {
                                    EXPECT_EQ(master.count("link_gone"), 0u);
                                    master.run_during("ip link del vxa");
                                    master.run(0.3);
                                  }});
  EXPECT_EQ(master.count("link_gone"), 1u) << master.log();
  EXPECT_EQ(master.count("link_back"), 1u) << master.log();
}

TEST_F(SocketCan, OneOfTwoBusesLostStopsTheJointsOfBoth) {
  Drives left("vxb", 1, 3), right("vxd", 1, 3);
  Master master(config({.interfaces = {"vxa", "vxc"}, .drives = 3}));
  ASSERT_TRUE(master.start()) << master.log();
  expect_stop(master, {&left, &right}, {netem("vxd", "loss 100%"), no_netem("vxd"), {"tpdo_lost"}});
  expect_stop(master, {&left, &right},
              {"ip link set vxc down", "ip link set vxc up", {"link_down"}});
}

TEST_F(SocketCan, SixDrivesOnOneVirtualInterface) {
  Drives drives("vcan0", 1, kDrives);
  Master master(config({.interfaces = {"vcan0"}}));
  ASSERT_TRUE(master.start()) << master.log();
  const std::uint64_t missed = master.count("tpdo_missed"), followed = drives.followed();
  master.run(3);
  EXPECT_EQ(master.count("tpdo_missed"), missed);
  EXPECT_GT(drives.followed() - followed, 7000u);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
  expect_stop(master, {&drives}, {"ip link set vcan0 down", "ip link set vcan0 up", {"link_down"}});
}

// What the plugin says of a configuration that it does not take.
std::string refusal(const Setup& setup) {
  try {
    const Master master(config(setup));
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST_F(SocketCan, MissingInterfaceIsNamedAtTheStart) {
  const std::string error = refusal({.interfaces = {"can7"}});
  EXPECT_NE(error.find("can7: no such interface"), std::string::npos) << error;
}

TEST_F(SocketCan, InterfaceThatIsDownIsNamedAtTheStart) {
  shell("ip link set vxa down");
  const std::string error = refusal({});
  EXPECT_NE(error.find("vxa is down"), std::string::npos) << error;
}

// can0 and can1: Kvaser cards emulated by QEMU, behind the kernel's own driver (kvaser_pci,
// sja1000).
TEST_F(SocketCan, OtherBitRateThanConfiguredIsNamedAtTheStart) {
  const std::string error = refusal({.interfaces = {"can0"}, .drives = 2, .bit_rate = 500'000});
  EXPECT_NE(error.find("can0 runs at 1000000 bit/s, configured are 500000"), std::string::npos)
      << error;
}

TEST_F(SocketCan, TwoDrivesBehindAControllersOwnDriver) {
  Drives drives("can1", 1, 2);
  Master master(config({.interfaces = {"can0"}, .drives = 2, .sync_rate_hz = 400}));
  ASSERT_TRUE(master.start()) << master.log();
  const std::uint64_t missed = master.count("tpdo_missed"), followed = drives.followed();
  master.run(3);
  std::printf("Kvaser, 2 drives: TPDOs missed %llu, RPDOs followed %llu\n",
              static_cast<unsigned long long>(master.count("tpdo_missed") - missed),
              static_cast<unsigned long long>(drives.followed() - followed));
  EXPECT_EQ(master.count("tpdo_missed"), missed);
  EXPECT_TRUE(master.all(WB_JOINT_FOLLOWING)) << master.log();
  expect_stop(master, {&drives}, {"ip link set can0 down", "ip link set can0 up", {"link_down"}});
}

}  // namespace
}  // namespace wb::can
