#include "drivers/dds/counters.hpp"

namespace wb::dds {

Counters::Counters() {
  static constexpr const char* kStreams[] = {"samples", "frames"};
  static constexpr const char* kKinds[] = {
      "malformed", "non_finite", "wrong_size", "wrong_source", "duplicate",   "out_of_order",
      "frozen",    "stale",      "future",     "encoding",     "uncalibrated"};
  static_assert(std::size(kStreams) == static_cast<std::size_t>(Stream::kCount));
  static_assert(std::size(kKinds) == kFaults);
  for (std::size_t s = 0; s < std::size(kStreams); ++s) {
    for (std::size_t k = 0; k < kFaults; ++k)
      names_[s * kFaults + k] = std::string(kStreams[s]) + "." + kKinds[k];
  }
  names_[kFrameLost] = "frames.lost";
  names_[kLeaseLost] = "lease.lost";
  names_[kCommandUnsent] = "commands.unsent";
  names_[kTickUnanswered] = "ticks.unanswered";
  for (std::size_t i = 0; i < kSize; ++i) name_pointers_[i] = names_[i].c_str();
}

}  // namespace wb::dds
