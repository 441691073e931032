// Names and ranges of the weights that may be tuned while the MPC runs. Setup world: terms register
// theirs as they are made; a step reads Weights by index. Limits and safety terms register nothing:
// their numbers are fixed at start.
#pragma once
#include <algorithm>
#include <string>
#include <vector>

#include "core/config/config.hpp"
#include "core/types/weights.hpp"

namespace wb {

struct WeightInfo {
  std::string name;  // as in mpc.yaml: "end_effector.position_pm2", "input.joint_...[2]"
  double configured = 0;
  double low = 0, high = 0;  // what tuning may set
};

class WeightTable {
 public:
  // Reads section.key and registers it as NAME.key. Throws config::ConfigError.
  int add(const config::Section& section, const std::string& term, const std::string& key,
          config::Range range) {
    return enter(section, key, term + "." + key, section.number(key, range), range);
  }
  // The same for a list of `count` numbers: returns the first index, the others follow.
  int add_list(const config::Section& section, const std::string& term, const std::string& key,
               int count, config::Range range) {
    const int first = static_cast<int>(infos_.size());
    const std::vector<double> values = section.numbers(key, count, range);
    for (int i = 0; i < count; ++i) {
      enter(section, key, term + "." + key + "[" + std::to_string(i) + "]", values[i], range);
    }
    return first;
  }

  const std::vector<WeightInfo>& infos() const { return infos_; }
  Weights configured() const {
    Weights out;
    out.count = static_cast<int>(infos_.size());
    for (int i = 0; i < out.count; ++i) out.values[i] = infos_[i].configured;
    return out;
  }
  // -1 if there is none of that name.
  int find(const std::string& name) const {
    for (std::size_t i = 0; i < infos_.size(); ++i) {
      if (infos_[i].name == name) return static_cast<int>(i);
    }
    return -1;
  }
  // Whether every entry may be used.
  bool accepts(const Weights& weights) const noexcept {
    if (weights.count != static_cast<int>(infos_.size())) return false;
    for (int i = 0; i < weights.count; ++i) {
      // A NaN fails both comparisons.
      if (!(weights.values[i] >= infos_[i].low && weights.values[i] <= infos_[i].high))
        return false;
    }
    return true;
  }

 private:
  // A live change by more than two orders of magnitude is a slip of the finger.
  static constexpr double kSpan = 100.0;

  int enter(const config::Section& section, const std::string& key, std::string name, double value,
            config::Range range) {
    if (infos_.size() == kMaxWeights)
      section.fail(key, "is one weight too many, allowed: " + std::to_string(kMaxWeights));
    const double low = std::max(range.low, range.low > 0 ? value / kSpan : range.low);
    const double high = std::min(range.high, kSpan * (value > 0 ? value : 1.0));
    infos_.push_back({std::move(name), value, low, high});
    return static_cast<int>(infos_.size()) - 1;
  }

  std::vector<WeightInfo> infos_;
};

}  // namespace wb
