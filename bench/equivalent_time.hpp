// Measures a step's thread CPU time in equivalent time: the sweep (bench/sweep.hpp) runs
// interleaved with it and says how fast the machine is at the moment (DEFINITIONS.md, "Equivalent
// time").
#pragma once
#include <algorithm>
#include <ctime>
#include <functional>
#include <utility>
#include <vector>

#include "bench/sweep.hpp"
#include "core/types/time.hpp"

namespace wb::bench {

inline double thread_cpu_ms() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

inline double quantile(std::vector<double> samples, double fraction) {
  if (samples.empty()) return 0;
  const auto k = std::min(samples.size() - 1,
                          static_cast<std::size_t>(fraction * static_cast<double>(samples.size())));
  std::nth_element(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(k),
                   samples.end());
  return samples[k];
}

class EquivalentTimer {
 public:
  // A sweep after every `every`-th step, so that it costs little.
  explicit EquivalentTimer(int every = 8) : every_(every) {}

  // The same function, timed.
  std::function<void(TimeNs)> wrap(std::function<void(TimeNs)> step) {
    return [this, step = std::move(step)](TimeNs t) { time([&] { step(t); }); };
  }

  template <class F>
  void time(F&& f) {
    const double before = thread_cpu_ms();
    f();
    const double after = thread_cpu_ms();
    steps_.push_back(after - before);
    if ((steps_.size() - 1) % every_ == 0) {
      const double start = thread_cpu_ms();
      checksum_ += sweep_.run();
      sweeps_.push_back(thread_cpu_ms() - start);
    }
  }

  // Equivalent milliseconds that `fraction` of the steps do not exceed; 0 if there were none.
  double quantile_ms(double fraction) const {
    if (sweeps_.empty()) return 0;
    return quantile(steps_, fraction) * kSweepReferenceMs / quantile(sweeps_, 0.5);
  }
  double sweep_median_ms() const { return quantile(sweeps_, 0.5); }
  double sweep_quantile_ms(double fraction) const { return quantile(sweeps_, fraction); }
  std::size_t steps() const { return steps_.size(); }
  double checksum() const { return checksum_; }

 private:
  std::size_t every_;
  Sweep sweep_;
  std::vector<double> steps_, sweeps_;
  double checksum_ = 0;
};

}  // namespace wb::bench
