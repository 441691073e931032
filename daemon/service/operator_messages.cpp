#include "daemon/service/operator_messages.hpp"

#include <charconv>
#include <chrono>
#include <cstdlib>

#include "core/config/config.hpp"

namespace wb {

std::string_view to_string(RequestOutcome outcome) {
  switch (outcome) {
    case RequestOutcome::kAccepted:
      return "accepted";
    case RequestOutcome::kRefused:
      return "refused";
    case RequestOutcome::kRunning:
      return "running";
    case RequestOutcome::kSucceeded:
      return "succeeded";
    case RequestOutcome::kFailed:
      return "failed";
  }
  return "?";
}

std::int64_t ros_now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

int domain_from_environment() {
  constexpr int kDomainMax = 232;  // the last one whose UDP ports fit into 16 bits
  const char* text = std::getenv("ROS_DOMAIN_ID");
  if (!text || !*text) return 0;
  const std::string_view view(text);
  int domain = -1;
  const auto [end, error] = std::from_chars(view.begin(), view.end(), domain);
  if (error != std::errc{} || end != view.end() || domain < 0 || domain > kDomainMax) {
    throw config::ConfigError("environment: ROS_DOMAIN_ID = '" + std::string(view) +
                              "' must be an integer in 0 .. " + std::to_string(kDomainMax));
  }
  return domain;
}

}  // namespace wb
