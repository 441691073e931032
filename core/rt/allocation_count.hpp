// Counts heap allocations of the calling thread, to check that steps make none. Tests and benches
// only: link wb_allocation_count, which puts counting wrappers in front of malloc and its kin.
#pragma once
#include <cstdint>

namespace wb {

// Allocations by this thread since it started. Always 0 where a sanitizer owns malloc (see
// allocations_are_counted).
std::uint64_t thread_allocations() noexcept;
bool allocations_are_counted() noexcept;

}  // namespace wb
