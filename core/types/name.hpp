// A short zero-terminated name that can travel through the buffers (trivially copyable).
#pragma once
#include <algorithm>
#include <array>
#include <string_view>

#include "core/types/limits.hpp"

namespace wb {

struct Name {
  std::array<char, kMaxNameLength> text{};

  Name() = default;
  // Truncates to kMaxNameLength - 1 characters; callers that must not lose any check the length
  // first.
  Name(std::string_view s) {  // NOLINT(google-explicit-constructor): a name is a string
    std::copy_n(s.begin(), std::min<std::size_t>(s.size(), text.size() - 1), text.begin());
  }
  std::string_view view() const { return {text.data()}; }
  bool operator==(const Name&) const = default;
};

}  // namespace wb
