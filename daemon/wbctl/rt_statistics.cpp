#include "daemon/wbctl/rt_statistics.hpp"

#include <algorithm>
#include <cmath>

namespace wb {
namespace {

double us(TimeNs ns) { return 1e-3 * static_cast<double>(ns); }

std::string number(double value) { return std::to_string(std::lround(value)); }

void conclude(const RtRun& run, RtReport& r) {
  const double stolen_ns = 1e7 * static_cast<double>(run.steal_ticks);
  if (r.cycles == 0) {
    r.reason = "no cycle ran";
  } else if (stolen_ns > kRtStealMax_fraction * static_cast<double>(run.duration_ns)) {
    r.reason = std::to_string(run.steal_ticks) + " ticks stolen";
  } else {
    r.verdict = RtReport::Verdict::kFail;
    const auto because = [&](const std::string& what) {
      r.reason += (r.reason.empty() ? "" : ", ") + what;
    };
    if (!run.real_time) because("no SCHED_FIFO");
    if (!run.memory_locked) because("memory not locked");
    if (r.overruns > 0) because(std::to_string(r.overruns) + " overruns");
    if (r.latency_max_us > kRtLatencyMax_us)
      because("woke up to " + number(r.latency_max_us) + " us late");
    if (run.page_faults > 0) because(std::to_string(run.page_faults) + " page faults");
    if (r.reason.empty()) r.verdict = RtReport::Verdict::kPass;
  }
}

}  // namespace

TimeNs quantile(const std::vector<TimeNs>& sorted, double fraction) {
  const auto rank =
      static_cast<std::size_t>(std::ceil(fraction * static_cast<double>(sorted.size())));
  return sorted[std::clamp<std::size_t>(rank, 1, sorted.size()) - 1];
}

RtReport judge(const RtRun& run) {
  RtReport r;
  r.cycles = static_cast<long>(run.wake_ns.size());
  r.overruns = run.skipped;
  std::vector<TimeNs> late;
  double sum_squares = 0;
  for (std::size_t i = 0; i < run.wake_ns.size(); ++i) {
    late.push_back(run.wake_ns[i] - run.release_ns[i]);
    if (i == 0) continue;
    const double deviation = us(late[i] - late[i - 1]);
    sum_squares += deviation * deviation;
    r.jitter_max_us = std::max(r.jitter_max_us, std::abs(deviation));
  }
  if (late.size() > 1) r.jitter_us = std::sqrt(sum_squares / static_cast<double>(late.size() - 1));
  std::sort(late.begin(), late.end());
  if (!late.empty()) {
    r.latency_p50_us = us(quantile(late, 0.5));
    r.latency_p99_us = us(quantile(late, 0.99));
    r.latency_p999_us = us(quantile(late, 0.999));
    r.latency_max_us = us(late.back());
  }
  conclude(run, r);
  return r;
}

}  // namespace wb
