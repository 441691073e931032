// A hundred thousand calls with random states, references, fields, weights, guesses and times, many
// of them no numbers: whatever comes, a policy leaves that can be followed. Seeded.
#include <gtest/gtest.h>

#include "bench/mpc_parts/situation.hpp"
#include "core/rt/allocation_count.hpp"

namespace wb::mpc_test {
namespace {

constexpr double kRateTolerance = 0.01;  // of the limit
#if defined(NDEBUG)
constexpr int kCalls = 100'000;
#else
constexpr int kCalls = 2'000;  // a build with sanitizers is fifty times as slow
#endif

class Fuzzer {
 public:
  explicit Fuzzer(std::shared_ptr<const OptimalControlProblem> problem)
      : problem_(std::move(problem)),
        solver_(problem_),
        situations_(problem_, 99),
        random_(99),
        policy_(std::make_unique<Policy>()),
        guess_(std::make_unique<Policy>()),
        field_({40, 40, 20}, 0.1) {
    field_.origin_W = {-2, -2, -0.5};
    field_.seq = 1;
  }

  // Returns the status; expects of every policy what its users rely on.
  SolveStatus call() {
    const bool spoil_state = chance(0.08), with_field = chance(0.7), with_guess = chance(0.2);
    StateVector x =
        chance(0.5) || policy_->nodes < 2 ? situations_.state(0.3) : StateVector(policy_->x(1));
    if (spoil_state) x[index(x.size())] = anything();
    randomise_reference();
    if (with_field && chance(0.1)) randomise_field();
    Weights weights = problem_->weights().configured();
    const bool with_weights = chance(0.5);
    if (with_weights) randomise(weights);
    if (with_guess) randomise_guess(x);
    t_ += chance(0.02) ? static_cast<TimeNs>(uniform(-20e9, 20e9)) : kNanosPerSecond / 30;
    const SolveInput input{.t0 = t_,
                           .x0 = x.data(),
                           .reference = &reference_,
                           .field = with_field ? &field_ : nullptr,
                           .guess = with_guess ? guess_.get() : nullptr,
                           .weights = with_weights ? &weights : nullptr};
    if (chance(0.01)) solver_.reset();
    const std::uint64_t allocations = thread_allocations();
    const SolveStatus status = solver_.solve(input, *policy_, report_);
    EXPECT_EQ(thread_allocations(), allocations);
    check(status);
    return status;
  }

  const SolverCounters& counters() const { return solver_.counters(); }

 private:
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  bool chance(double p) { return uniform(0, 1) < p; }
  Eigen::Index index(Eigen::Index count) {
    return std::uniform_int_distribution<Eigen::Index>(0, count - 1)(random_);
  }
  double anything() {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const double values[] = {std::nan(""), kInfinity, -kInfinity, 1e300, -1e300, 1e30,
                             -1e30,        0.0,       1e-300,     1e3,   -1e3,   uniform(-10, 10)};
    return values[index(std::size(values))];
  }

  void randomise_reference() {
    Node node;
    situations_.randomise(node);
    reference_ = *node.reference;
    if (chance(0.3)) {
      EndEffectorReference& ee = reference_.ee[0];
      ee.count = static_cast<int>(index(kMaxKeyframes + 2)) - 1;
      TimeNs at = t_;
      for (auto& keyframe : ee.keyframes) {
        at += static_cast<TimeNs>(uniform(chance(0.02) ? -1e9 : 0, 1e9));
        keyframe = {at, ee.keyframes[0].X_WE};
        keyframe.X_WE.p[0] += uniform(-0.3, 0.3);
      }
    }
    if (chance(0.5)) {
      for (auto& ee : reference_.ee) ee.wrench_active = ee.twist_active = false;
    }
    if (chance(0.7)) {
      for (auto& ee : reference_.ee) ee.constraint_count = 0;
    }
    if (chance(0.85)) return;
    // One number of it becomes anything.
    EndEffectorReference& ee = reference_.ee[0];
    double* numbers[] = {&ee.keyframes[index(3)].X_WE.p[index(3)],
                         &ee.keyframes[index(3)].X_WE.q[index(4)],
                         &ee.position_scale,
                         &ee.orientation_scale,
                         &ee.twist_W[index(6)],
                         &ee.wrench_W[index(6)],
                         &ee.constraints[0].row[index(6)],
                         &ee.constraints[0].rate,
                         &reference_.base[0].base[index(3)],
                         &reference_.base_scale,
                         &reference_.posture[index(6)],
                         &reference_.posture_scale,
                         &reference_.speed_scale,
                         &reference_.masks[0].X_WM.p[index(3)],
                         &reference_.masks[0].half_extent[index(3)]};
    *numbers[index(std::size(numbers))] = anything();
  }

  void randomise_field() {
    const auto [nx, ny, nz] = field_.size();
    const bool spoilt = chance(0.1);
    for (int i = 0; i < nx * ny * nz; ++i)
      field_.data()[i] =
          static_cast<float>(spoilt && chance(0.001) ? anything() : uniform(-0.5, 2));
  }

  void randomise(Weights& weights) {
    const auto& infos = problem_->weights().infos();
    weights.revision = 1 + index(1000);
    for (int i = 0; i < weights.count; ++i)
      weights.values[i] = uniform(infos[i].low, infos[i].high);
    if (chance(0.1)) weights.values[index(weights.count)] = anything();
    if (chance(0.02)) weights.count = static_cast<int>(index(kMaxWeights));
  }

  void randomise_guess(const StateVector& x) {
    Policy& g = *guess_;
    g.nodes = static_cast<int>(index(30));
    g.states = static_cast<int>(x.size());
    g.inputs = problem_->nu();
    for (int i = 0; i < g.nodes; ++i) {
      g.t[i] = t_ + i * TimeNs{100'000'000};
      g.x(i) = x;
      for (int r = 0; r < g.inputs; ++r) g.u(i)[r] = chance(0.001) ? anything() : uniform(-1, 1);
      g.K(i).setZero();
    }
  }

  void check(SolveStatus status) {
    const Policy& p = *policy_;
    ASSERT_GE(p.nodes, 2);
    ASSERT_EQ(p.t_ns, t_);
    const double scale =
        reference_.speed_scale > 0 && reference_.speed_scale <= 1 ? reference_.speed_scale : 1.0;
    for (int i = 0; i < p.nodes; ++i) {
      ASSERT_TRUE(p.x(i).allFinite()) << "node " << i;
      if (i + 1 == p.nodes) break;
      ASSERT_GT(p.t[i + 1], p.t[i]);
      ASSERT_TRUE(p.u(i).allFinite() && p.K(i).allFinite()) << "node " << i;
      for (int r = 0; r < p.inputs; ++r) {
        ASSERT_LE(std::abs(p.u(i)[r]),
                  (1 + kRateTolerance) * scale * problem_->limits().velocity[r]);
      }
    }
    if (status == SolveStatus::kNotFinite) {
      EXPECT_NE(report_.trouble.kind, TroubleKind::kNone);
      EXPECT_EQ(p.quality, PolicyQuality::kKept);
    } else if (reference_.ee[0].constraint_count <= 0) {
      const double slack = 1e-9 * (1 + std::abs(report_.cost_before));
      EXPECT_LE(report_.cost_after, report_.cost_before + slack) << "worse than the last, shifted";
    }
    if (status == SolveStatus::kNoStep || status == SolveStatus::kShortened) {
      EXPECT_NE(report_.trouble.kind, TroubleKind::kNone);
    }
    EXPECT_FALSE(describe(*problem_, report_.trouble).empty());
    const WorkBound bound = solver_.work_bound();
    EXPECT_LE(report_.node_evaluations, bound.node_evaluations);
    EXPECT_LE(report_.term_evaluations, bound.term_evaluations);
    EXPECT_LE(report_.factorisations, bound.factorisations);
  }

  std::shared_ptr<const OptimalControlProblem> problem_;
  SlqSolver solver_;
  bench::Situations situations_;
  std::mt19937 random_;
  std::unique_ptr<Policy> policy_, guess_;
  SolveReport report_;
  Reference reference_;
  DistanceField field_;
  TimeNs t_ = 0;
};

TEST(SlqSolverFuzz, WhateverComesAPolicyLeavesThatCanBeFollowed) {
  // Half a second of horizon: the same code on fewer nodes.
  const GridSettings grid{0.04, 0.2, 0.1, 0.7};
  const auto model = bench::load_robot("mabi_mobile");
  Fuzzer fuzzer(std::make_shared<const OptimalControlProblem>(
      model, config::Section::open(model->config().folder / "mpc.yaml"), std::vector<std::string>{},
      &grid));
  int good = 0, kept = 0;
  for (int call = 0; call < kCalls && !testing::Test::HasFailure(); ++call) {
    const SolveStatus status = fuzzer.call();
    good += status == SolveStatus::kConverging;
    kept += status == SolveStatus::kNotFinite;
  }
  // The calls reach every way that a solve can end.
  EXPECT_GT(good, kCalls / 4);
  EXPECT_GT(kept, kCalls / 100);
  EXPECT_GT(fuzzer.counters().shortened, 0u);
  EXPECT_GT(fuzzer.counters().no_step, 0u);
  EXPECT_GT(fuzzer.counters().refused_weights, 0u);
}

}  // namespace
}  // namespace wb::mpc_test
