// What tests ask of the conformance suite's results.
#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "drivers/check/driver_check.hpp"

namespace wb::check {

inline std::vector<std::string> failed(const std::vector<Result>& results) {
  std::vector<std::string> names;
  for (const Result& r : results) {
    if (r.outcome == Outcome::kFailed) names.push_back(r.name);
  }
  return names;
}

// `name` failed because of `reason` (a part of it).
inline void expect_failed(const std::vector<Result>& results, const std::string& name,
                          const std::string& reason) {
  const auto r = std::ranges::find(results, name, &Result::name);
  ASSERT_NE(r, results.end()) << name;
  EXPECT_EQ(r->outcome, Outcome::kFailed) << name << ": " << r->reason;
  EXPECT_NE(r->reason.find(reason), std::string::npos) << name << ": " << r->reason;
}

}  // namespace wb::check
