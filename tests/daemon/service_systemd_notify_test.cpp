// Facts about systemd_notify.hpp, with the test in systemd's place at the other end of the
// notification socket.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <string>

#include "daemon/service/systemd_notify.hpp"

namespace wb {
namespace {

class NotifySocket {
 public:
  NotifySocket() : path_(::testing::TempDir() + "notify_" + std::to_string(getpid())) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path_.c_str(), sizeof address.sun_path - 1);
    socket_ = socket(AF_UNIX, SOCK_DGRAM, 0);
    const int bound = bind(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address);
    EXPECT_EQ(bound, 0) << path_;
    setenv("NOTIFY_SOCKET", path_.c_str(), 1);
  }
  ~NotifySocket() {
    unsetenv("NOTIFY_SOCKET");
    close(socket_);
    unlink(path_.c_str());
  }
  // What was said since, or nothing; sd_notify has returned, so it is there already.
  std::string said() const {
    std::array<char, 256> text{};
    const ssize_t size = recv(socket_, text.data(), text.size(), MSG_DONTWAIT);
    return size > 0 ? std::string(text.data(), size) : "";
  }

 private:
  std::string path_;
  int socket_ = -1;
};

TEST(SystemdNotify, SaysWhatSystemdUnderstands) {
  NotifySocket socket;
  systemd::ready();
  EXPECT_EQ(socket.said(), "READY=1");
  systemd::watchdog();
  EXPECT_EQ(socket.said(), "WATCHDOG=1");
  systemd::status("active");
  EXPECT_EQ(socket.said(), "STATUS=active");
  systemd::stopping();
  EXPECT_EQ(socket.said(), "STOPPING=1");
}

TEST(SystemdNotify, WatchdogIsFedThreeTimesAPeriodOrNotAtAll) {
  unsetenv("WATCHDOG_USEC");
  EXPECT_EQ(systemd::watchdog_period_ns(), 0);
  setenv("WATCHDOG_USEC", "900000", 1);
  setenv("WATCHDOG_PID", std::to_string(getpid()).c_str(), 1);
  EXPECT_EQ(systemd::watchdog_period_ns(), 300'000'000);
  setenv("WATCHDOG_PID", std::to_string(getpid() + 1).c_str(), 1);  // meant for another process
  EXPECT_EQ(systemd::watchdog_period_ns(), 0);
  unsetenv("WATCHDOG_USEC");
  unsetenv("WATCHDOG_PID");
}

}  // namespace
}  // namespace wb
