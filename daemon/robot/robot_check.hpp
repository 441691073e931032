// `wbctl robot check`: proves that a robot's folder can be controlled, line by line with a number
// each. Setup world. Frame B, SI units.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace wb {

struct CheckLine {
  std::string name;
  bool ok = false;
  double value = 0;  // in `unit`
  std::string unit;
  std::string text;  // what the number is, and what it must be; the error if there was one
};

struct CheckOptions {
  int samples = 40;  // of each sampled check
  unsigned seed = 1;
};

// Without robot.yaml, model and MPC there is one line, and it has failed.
std::vector<CheckLine> check_robot(const std::filesystem::path& folder,
                                   const CheckOptions& options);

}  // namespace wb
