#include "core/model/import/posture_search.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace wb {
namespace {

using Eigen::Vector3d;
constexpr double kFloor_m = 0.02;
constexpr double kHandleHeight_m = 0.8;
constexpr double kLoadMax = 0.9;  // of a joint's torque, by gravity

// std::uniform_real_distribution is not the same everywhere.
double uniform(std::mt19937_64& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1.0p-53;
}

std::vector<double> sample(const ArmRange& range, std::mt19937_64& random, double margin = 0) {
  std::vector<double> q;
  for (std::size_t j = 0; j < range.lower.size(); ++j) {
    const double m = margin * (range.upper[j] - range.lower[j]);
    q.push_back(uniform(random, range.lower[j] + m, range.upper[j] - m));
  }
  return q;
}

struct Stow {
  std::vector<double> q;
  double cost = 0;
};

class Search {
 public:
  // `undisturbed`: where no barrier of the MPC reaches.
  Search(const RobotModel& model, const SamplingOptions& options, bool undisturbed)
      : model_(model),
        range_(arm_range(model)),
        options_(options),
        clear_m_(kPairDistance_m + (undisturbed ? kPairReach_m : 0.01)),
        spare_(undisturbed ? kLimitDistance + limit_reach(model) : 0),
        random_(options.seed) {}

  // Clear of itself and of the floor, and carried with ease.
  bool holds(const std::vector<double>& q) const {
    const RobotModel::Data data = arm_data(model_, q);
    return pair_distance(model_, data) >= clear_m_ && above_floor(data) && load(q) <= kLoadMax;
  }

  std::vector<Stow> stows() {
    std::vector<Stow> best;
    for (int i = 0; i < options_.samples; ++i) {
      const std::vector<double> q = sample(range_, random_, 0.03);
      const double c = stow_cost(q);
      if (best.size() >= kKeep && c >= best.back().cost) continue;
      if (!holds(q)) continue;
      insert(best, {q, c});
    }
    for (Stow& s : best) {
      double sigma = 0.2;
      for (int i = 0; i < options_.samples / 40; ++i, sigma *= 0.995) {
        std::vector<double> q = s.q;
        for (std::size_t j = 0; j < q.size(); ++j) {
          const double m = 0.03 * (range_.upper[j] - range_.lower[j]);
          q[j] = std::clamp(q[j] + uniform(random_, -sigma, sigma), range_.lower[j] + m,
                            range_.upper[j] - m);
        }
        const double c = stow_cost(q);
        if (c < s.cost && holds(q)) s = {q, c};
      }
    }
    std::sort(best.begin(), best.end(), [](auto& a, auto& b) { return a.cost < b.cost; });
    return best;
  }

  struct Ready {
    std::vector<double> q;
    double score = 0, angle = 0;
  };
  std::vector<Ready> readies(double base_front_m) {
    const double reach = arm_reach(model_);
    const RobotModel::Data zero = arm_data(model_, std::vector<double>(range_.lower.size()));
    const Vector3d shoulder = zero.X_WL[1].translation();
    const double height =
        std::clamp(kHandleHeight_m, shoulder.z() - 0.5 * reach, shoulder.z() + 0.5 * reach);
    std::vector<Ready> best;
    for (const double dz : {0.0, -0.15, 0.15}) {
      for (double share = 0.3; share < 0.91; share += 0.1) {
        const double x = std::max(shoulder.x() + share * reach, base_front_m + 0.15);
        for (int roll = 0; roll < 4; ++roll) {
          Eigen::Isometry3d X_BE = Eigen::Isometry3d::Identity();
          X_BE.translation() = Vector3d(x, 0, height + dz);
          X_BE.linear() = forward(roll);
          for (int start = 0; start < kStarts; ++start) {
            const IkResult r = solve_ik(model_, range_, X_BE, sample(range_, random_, 0.1));
            if (r.position_error_m > 0.02 || limit_margin(r.q) < spare_ || !holds(r.q)) continue;
            const double margin = std::min(1.0, limit_margin(r.q) / 0.3) * pair_margin(r.q);
            const double score = least_singular_value(model_, r.q, reach) * margin *
                                 std::exp(-std::abs(dz) / 0.3 - r.angle_error_rad / 0.1);
            if (best.size() >= kKeep && score <= best.back().score) continue;
            best.push_back({r.q, score, r.angle_error_rad});
            std::sort(best.begin(), best.end(), [](auto& a, auto& b) { return a.score > b.score; });
            if (best.size() > kKeep) best.pop_back();
          }
        }
      }
    }
    if (best.empty()) sample_readies(base_front_m, height, best);
    return best;
  }

 private:
  // An arm with few joints reaches no given pose: the posture that comes nearest to being ready.
  void sample_readies(double base_front_m, double height, std::vector<Ready>& best) {
    for (int i = 0; i < options_.samples; ++i) {
      const std::vector<double> q = sample(range_, random_, 0.1);
      const RobotModel::Data data = arm_data(model_, q);
      const Eigen::Isometry3d X = model_.X_WF(model_.end_effector(), data);
      const double angle = std::acos(std::clamp(X.linear()(0, 2), -1.0, 1.0));
      const double before = std::max(0.0, base_front_m + 0.15 - X.translation().x());
      const double score = std::exp(-(before + std::abs(X.translation().y())) / 0.1 -
                                    std::abs(X.translation().z() - height) / 0.3 - angle / 0.5);
      if (!best.empty() && score <= best[0].score) continue;
      if (holds(q)) best = {{q, score, angle}};
    }
  }

  static constexpr std::size_t kKeep = 8;
  static constexpr int kStarts = 5;

  static void insert(std::vector<Stow>& best, Stow s) {
    best.push_back(std::move(s));
    std::sort(best.begin(), best.end(), [](auto& a, auto& b) { return a.cost < b.cost; });
    if (best.size() > kKeep) best.pop_back();
  }

  // z along x of B; y up, left, down, right.
  static Eigen::Matrix3d forward(int roll) {
    Eigen::Matrix3d R;
    R.col(2) = Vector3d::UnitX();
    R.col(1) = Vector3d::UnitZ();
    R.col(0) = R.col(1).cross(R.col(2));
    return R * Eigen::AngleAxisd(roll * std::numbers::pi / 2, Vector3d::UnitZ()).matrix();
  }

  bool above_floor(const RobotModel::Data& data) const {
    for (const Sphere& s : model_.spheres()) {
      if (s.body > 1 && (data.X_WL[s.body] * s.centre).z() - s.radius < kFloor_m) return false;
    }
    return true;
  }

  double load(const std::vector<double>& q) const {
    JointVector tau;
    model_.gravity(q.data(), tau);
    double largest = 0;
    for (int j = 0; j < model_.joints(); ++j)
      largest = std::max(largest, std::abs(tau[j]) / model_.limits(j).torque);
    return largest;
  }

  // The circle; a low, lightly loaded arm where circles are equal.
  double stow_cost(const std::vector<double>& q) const {
    const RobotModel::Data data = arm_data(model_, q);
    double top = 0;
    for (const Sphere& s : model_.spheres())
      top = std::max(top, (data.X_WL[s.body] * s.centre).z() + s.radius);
    return radius_about_base(model_, q) + 0.1 * top + 0.05 * load(q);
  }

  // 1 out of the reach of the MPC's self-collision, 0 at the distance that it keeps.
  double pair_margin(const std::vector<double>& q) const {
    const double spare = pair_distance(model_, arm_data(model_, q)) - kPairDistance_m;
    return std::clamp(spare / kPairReach_m, 0.0, 1.0);
  }

  double limit_margin(const std::vector<double>& q) const {
    double margin = 1e9;
    for (std::size_t j = 0; j < q.size(); ++j) {
      if (model_.limits(static_cast<int>(j)).endless()) continue;
      margin = std::min({margin, q[j] - range_.lower[j], range_.upper[j] - q[j]});
    }
    return std::max(0.0, margin);
  }

  const RobotModel& model_;
  ArmRange range_;
  SamplingOptions options_;
  double clear_m_;  // that the pairs are apart
  double spare_;    // between a joint and its limit, ready
  std::mt19937_64 random_;
};

}  // namespace

std::vector<PairSample> sample_pairs(const RobotModel& model, const SamplingOptions& options,
                                     double always) {
  std::vector<PairSample> out;
  const auto& capsules = model.capsules();
  for (int i = 0; i < static_cast<int>(capsules.size()); ++i) {
    for (int j = i + 1; j < static_cast<int>(capsules.size()); ++j) {
      if (std::abs(capsules[i].body - capsules[j].body) <= 1) continue;
      out.push_back({{i, j}, 0, 0, 1e9, {}});
    }
  }
  const int samples = std::max(200, options.samples / 5);
  const ArmRange range = arm_range(model);
  std::mt19937_64 random(options.seed);
  for (int k = 0; k < samples; ++k) {
    const RobotModel::Data data = arm_data(model, sample(range, random));
    for (PairSample& p : out) {
      const double d = capsule_distance(data, capsules[p.pair[0]], capsules[p.pair[1]]);
      p.least_m = std::min(p.least_m, d);
      p.near += (d < kPairDistance_m) / static_cast<double>(samples);
      p.touching += (d < 0) / static_cast<double>(samples);
    }
  }
  for (PairSample& p : out) {
    using enum PairSample::Verdict;
    // Often near and never touching: the joints keep them apart.
    const bool apart = p.near <= 0 || (p.touching <= 0 && p.near > 0.05);
    p.verdict = apart ? kApart : p.near > always ? kAlwaysNear : kKept;
  }
  return out;
}

double limit_reach(const RobotModel& model) {
  double reach = 0.2;
  for (int j = 0; j < model.joints(); ++j) {
    const JointLimits& l = model.limits(j);
    if (!l.endless()) reach = std::min(reach, 0.25 * (l.upper - l.lower));
  }
  return reach;
}

double arm_reach(const RobotModel& model) {
  const RobotModel::Data data = arm_data(model, std::vector<double>(model.joints()));
  double reach = 0;
  for (int i = 1; i < model.joints(); ++i)
    reach += (data.X_WL[i + 1].translation() - data.X_WL[i].translation()).norm();
  return reach + (model.X_WF(model.end_effector(), data).translation() -
                  data.X_WL[model.joints()].translation())
                     .norm();
}

double path_distance(const RobotModel& model, const std::vector<double>& from,
                     const std::vector<double>& to) {
  double nearest = 1e9;
  constexpr int kSteps = 50;
  for (int k = 0; k <= kSteps; ++k) {
    std::vector<double> q = from;
    for (std::size_t j = 0; j < q.size(); ++j) q[j] += (to[j] - from[j]) * k / kSteps;
    nearest = std::min(nearest, pair_distance(model, arm_data(model, q)));
  }
  return nearest;
}

double radius_about_base(const RobotModel& model, const std::vector<double>& q) {
  const RobotModel::Data data = arm_data(model, q);
  double radius = 0;
  for (const Sphere& s : model.spheres()) {
    radius = std::max(radius, (data.X_WL[s.body] * s.centre).head<2>().norm() + s.radius);
  }
  return radius;
}

Postures find_postures(const RobotModel& model, double base_front_m,
                       const SamplingOptions& options) {
  std::vector<Stow> stows;
  std::vector<Search::Ready> readies;
  for (const bool undisturbed : {true, false}) {
    Search search(model, options, undisturbed);
    stows = search.stows();
    readies = search.readies(base_front_m);
    if (!stows.empty() && !readies.empty()) break;
  }
  Postures out;
  if (stows.empty() || readies.empty()) return out;
  out.collision_free = true;
  // The best two between which the arm can move straight; else the best of each.
  std::size_t stowed = 0, ready = 0;
  for (std::size_t sum = 0; sum < stows.size() + readies.size() - 1 && !out.path_free; ++sum) {
    for (std::size_t r = 0; r <= sum && !out.path_free; ++r) {
      if (r >= readies.size() || sum - r >= stows.size()) continue;
      if (path_distance(model, stows[sum - r].q, readies[r].q) < kPairDistance_m) continue;
      out.path_free = true;
      stowed = sum - r;
      ready = r;
    }
  }
  out.stowed = stows[stowed].q;
  out.ready = readies[ready].q;
  for (auto* q : {&out.stowed, &out.ready}) {
    for (double& value : *q) value = std::round(value * 1e4) / 1e4;  // as it is written
  }
  out.ready_angle_rad = readies[ready].angle;
  out.stowed_radius_m = radius_about_base(model, out.stowed);
  out.stowed_distance_m = pair_distance(model, arm_data(model, out.stowed));
  const RobotModel::Data data = arm_data(model, out.ready);
  out.ready_distance_m = pair_distance(model, data);
  out.ready_singular_value = least_singular_value(model, out.ready, arm_reach(model));
  out.p_BE_ready = model.X_WF(model.end_effector(), data).translation();
  return out;
}

}  // namespace wb
