// What every step was handed, as fixed-size records; with the frames they are enough to run the
// steps again, bit for bit. Trivially copyable. Sequence numbers name values that the replay
// recomputes (policies, states, fields) or finds stored (plans, frames).
#pragma once
#include <array>
#include <cstdint>

#include "core/types/readings.hpp"
#include "core/types/request.hpp"
#include "mapping/mapper.hpp"
#include "mpc/slq_solver.hpp"

namespace wb {

struct ControlRecord {
  TimeNs t_ns = 0;
  Readings readings;
  std::uint64_t policy_seq = 0;  // 0: none taken
  std::uint64_t plan_seq = 0;
  int request_count = 0;
  std::array<Request, kMaxRequests> requests{};
  std::uint64_t state_hash = 0;  // over all steps so far, this one included
};

struct MpcRecord {
  std::uint64_t seq = 0;
  TimeNs t_ns = 0;
  std::uint64_t state_seq = 0, reference_seq = 0, field_seq = 0;
  bool cold = false;  // first since control last stopped following: the warm start was forgotten
  std::uint64_t policy_seq = 0;  // of the result
  Weights weights;               // that the step was handed
  SolveReport report;
  // What the loop says of itself; no step was handed it, and no replay compares it.
  TimeNs cpu_ns = 0;  // thread CPU time of the step
  SolverCounters counters;
  Trouble newest_trouble;
};

struct MappingRecord {
  static constexpr int kMaxFrames = 16;
  TimeNs t_ns = 0;
  std::uint64_t first_state_seq =
      0;  // states taken from the queue: first_state_seq ... + state_count - 1
  int state_count = 0;
  int frame_count = 0;
  std::array<std::uint64_t, kMaxFrames> frame_seqs{};
  std::uint64_t field_seq = 0;  // of the result
  MapReport report;
};

}  // namespace wb
