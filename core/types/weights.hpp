// The MPC's weights that may be changed between two solves. Travels service -> MPC by value, so
// that a step stays pure and a recording holds what it was handed. Which entry is which, and what
// it may be: WeightTable (mpc/weight_table.hpp). Trivially copyable.
#pragma once
#include <array>
#include <cstdint>

#include "core/types/limits.hpp"

namespace wb {

struct Weights {
  std::uint64_t revision = 0;  // 0: as configured
  int count = 0;
  std::array<double, kMaxWeights> values{};
};

}  // namespace wb
