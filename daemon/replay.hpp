// Runs the steps of a recording again on what they were handed, and compares the state hash after
// every control step. Setup world. Policies, states and fields are recomputed; plans and frames
// come from the file.
#pragma once
#include <cstdint>
#include <filesystem>
#include <string>

namespace wb {

struct ReplayResult {
  std::uint64_t control_steps = 0, mpc_steps = 0, mapping_steps = 0;
  bool equal = false;
  std::int64_t first_difference = -1;  // index of the first control step that differs
  double first_difference_s = 0;       // its time since the recording's start
  std::uint64_t state_hash = 0;        // of the replay
  std::string problem;                 // what could not be replayed, empty if nothing
};

// Throws std::runtime_error for a file that is no recording of this build.
ReplayResult replay(const std::filesystem::path& file);

// `wbctl replay`: prints the result; 0 if every step is equal, 1 if not, 2 if the file cannot be
// replayed.
int replay_main(const std::filesystem::path& file, bool json);

}  // namespace wb
