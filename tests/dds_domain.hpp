// What tests that speak DDS share: a domain that other programs' tests do not hear, and patience.
#pragma once
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <functional>
#include <string>
#include <thread>

namespace wb::test {

// Bound on whatever discovery, delivery or the scheduler has to do; reached only when a test fails.
inline constexpr double kPatienceS = 20;

inline bool wait_until(const std::function<bool()>& condition, double timeout_s = kPatienceS) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

// Of this process: loopback only, and a tag, since participants of different tags ignore each
// other. Holds for child processes, too. Returns the domain, 1 to 100, which they take by default.
inline int own_dds_domain() {
  const std::string uri =
      "file://" WB_SOURCE_DIR
      "/config/cyclonedds_loopback.xml,<CycloneDDS><Domain><Discovery><Tag>wb_test_" +
      std::to_string(getpid()) + "</Tag></Discovery></Domain></CycloneDDS>";
  const int domain = 1 + getpid() % 100;
  setenv("CYCLONEDDS_URI", uri.c_str(), 1);
  setenv("ROS_DOMAIN_ID", std::to_string(domain).c_str(), 1);
  return domain;
}

}  // namespace wb::test
