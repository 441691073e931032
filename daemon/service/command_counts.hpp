// How many commands were handed on and how many refused, by kind. Written by the service's thread,
// read by any.
#pragma once
#include <array>
#include <atomic>
#include <cstdint>

#include "daemon/service/command_check.hpp"

namespace wb {

class CommandCounts {
 public:
  // kNone counts a command that was handed on.
  void count(Refusal kind) { of_[index(kind)].fetch_add(1, std::memory_order_relaxed); }
  std::uint64_t of(Refusal kind) const { return of_[index(kind)].load(std::memory_order_relaxed); }

 private:
  static std::size_t index(Refusal kind) { return static_cast<std::size_t>(kind); }
  std::array<std::atomic<std::uint64_t>, kRefusalKinds> of_{};
};

}  // namespace wb
