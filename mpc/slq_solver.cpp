#include "mpc/slq_solver.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "mpc/reference_sample.hpp"
#include "mpc/riccati.hpp"

namespace wb {
namespace {

// Part of the promised decrease that a step must deliver (Armijo), and what rounding may take from
// it.
constexpr double kArmijo = 1e-3;
constexpr double kRounding = 1e-12;

// Regularisation (an extra input weight, unit of R): zero while full steps are accepted; a call
// without a step raises it eightfold from kRegularisationFirst, a full step lowers it eightfold.
constexpr double kRegularisationFirst = 1e-2, kRegularisationMost = 1e2,
                 kRegularisationFactor = 8.0;

struct Trajectory {
  std::array<StateVector, kMaxNodes> x;
  std::array<InputVector, kMaxNodes> u;
  std::array<double, kMaxTerms> term_cost{};
  double cost = 0;
  std::uint64_t active_spheres = 0;
};

bool all_finite(const double* values, int count) {
  return std::all_of(values, values + count, [](double v) { return std::isfinite(v); });
}

// The node whose input acts at t: the last one at or before it, the first for earlier times.
int node_at(const Policy& policy, TimeNs t) {
  const auto after = std::upper_bound(policy.t.begin(), policy.t.begin() + policy.nodes, t);
  return std::max(0, static_cast<int>(after - policy.t.begin()) - 1);
}

// Copies what is in use: a Policy is a quarter of a megabyte, most of it spare.
void copy(const Policy& from, Policy& to) {
  to.seq = from.seq;
  to.t_ns = from.t_ns;
  to.reference_seq = from.reference_seq;
  to.field_seq = from.field_seq;
  to.nodes = from.nodes;
  to.states = from.states;
  to.inputs = from.inputs;
  std::copy_n(from.t.begin(), from.nodes, to.t.begin());
  std::copy_n(from.x_data.begin(), from.nodes * from.states, to.x_data.begin());
  std::copy_n(from.u_data.begin(), from.nodes * from.inputs, to.u_data.begin());
  std::copy_n(from.k_data.begin(), from.nodes * from.inputs * from.states, to.k_data.begin());
}

}  // namespace

std::string_view to_string(SolveStatus status) {
  switch (status) {
    case SolveStatus::kConverging:
      return "converging";
    case SolveStatus::kNoStep:
      return "no step";
    case SolveStatus::kNotFinite:
      return "not finite";
  }
  return "?";
}

struct SlqSolver::Workspace {
  explicit Workspace(std::shared_ptr<const OptimalControlProblem> p)
      : problem(std::move(p)), stages(problem->nodes() - 1) {
    last.states = problem->nx();
    last.inputs = problem->nu();
  }

  SolveStatus solve(const SolveInput& input, Policy& policy, SolveReport& report) noexcept;
  bool prepare(const SolveInput& input) noexcept;
  void set_input_box(const SolveInput& input) noexcept;
  void shift(const Policy& from, const SolveInput& input) noexcept;
  bool start(const SolveInput& input) noexcept;
  bool linearise_warm_start(const SolveInput& input) noexcept;
  double roll_out(double length, double worst) noexcept;
  double visit(int i, const StateVector& x, const InputVector* u, Quadratic* quadratic,
               Trajectory& trajectory) noexcept;
  void publish(const SolveInput& input, const Trajectory& trajectory, bool new_gains,
               Policy& policy) noexcept;

  std::shared_ptr<const OptimalControlProblem> problem;
  std::array<TimeNs, kMaxNodes> t{};
  std::array<ReferenceSample, kMaxNodes> samples;
  std::array<InputVector, kMaxNodes> lower, upper;  // of the inputs
  std::vector<LqStage> stages;
  Quadratic terminal;
  Node node;
  Trajectory trajectories[2];
  Trajectory* now = &trajectories[0];   // about which the problem is linearised
  Trajectory* next = &trajectories[1];  // tried by the line search
  Policy shifted;                       // the warm start on the new grid
  Policy last;                          // nodes = 0: none
  double regularisation = 0;
  std::uint64_t solves = 0;
};

SlqSolver::SlqSolver(std::shared_ptr<const OptimalControlProblem> problem)
    : workspace_(std::make_unique<Workspace>(std::move(problem))) {}
SlqSolver::~SlqSolver() = default;

SolveStatus SlqSolver::solve(const SolveInput& input, Policy& policy, SolveReport& report) RT_SAFE {
  return workspace_->solve(input, policy, report);
}

void SlqSolver::reset() RT_SAFE {
  workspace_->last.nodes = 0;
  workspace_->regularisation = 0;
}

// Samples the reference at the nodes. False if the input cannot be solved from.
bool SlqSolver::Workspace::prepare(const SolveInput& input) noexcept {
  node.reference = input.reference;
  node.field = input.field;
  for (int i = 0; i < problem->nodes(); ++i) samples[i] = sample(*input.reference, t[i]);
  return input.reference->speed_scale > 0.0 && input.reference->speed_scale <= 1.0 &&
         all_finite(input.x0, problem->nx());
}

// A policy, seen from the new grid: states interpolated, inputs averaged over the new
// intervals (which keeps where they lead), gains of the node in force. Without nodes: stay where
// x0 is.
void SlqSolver::Workspace::shift(const Policy& from_policy, const SolveInput& input) noexcept {
  const int count = problem->nodes(), nx = problem->nx(), nu = problem->nu();
  shifted.nodes = count;
  shifted.states = nx;
  shifted.inputs = nu;
  std::copy_n(t.begin(), count, shifted.t.begin());
  std::fill_n(shifted.u_data.begin(), count * nu, 0.0);
  std::fill_n(shifted.k_data.begin(), count * nu * nx, 0.0);
  if (from_policy.nodes == 0) {
    for (int i = 0; i < count; ++i) {
      for (int r = 0; r < nx; ++r) shifted.x(i)[r] = std::isfinite(input.x0[r]) ? input.x0[r] : 0.0;
    }
    return;
  }
  const TimeNs end = from_policy.t[from_policy.nodes - 1];
  for (int i = 0; i < count; ++i) {
    const int from = std::min(node_at(from_policy, t[i]), from_policy.nodes - 2);
    const double s =
        std::clamp(static_cast<double>(t[i] - from_policy.t[from]) /
                       static_cast<double>(from_policy.t[from + 1] - from_policy.t[from]),
                   0.0, 1.0);
    for (int r = 0; r < nx; ++r) {
      shifted.x(i)[r] = (1.0 - s) * from_policy.x(from)[r] + s * from_policy.x(from + 1)[r];
    }
    if (i + 1 == count || t[i] >= end) continue;
    std::copy_n(from_policy.K(from).data(), nu * nx, shifted.K(i).data());
    for (int j = from; j + 1 < from_policy.nodes; ++j) {
      const TimeNs begins = j == from ? t[i] : from_policy.t[j];
      if (begins >= t[i + 1]) break;
      const double part = static_cast<double>(std::min(from_policy.t[j + 1], t[i + 1]) - begins) /
                          static_cast<double>(t[i + 1] - t[i]);
      for (int r = 0; r < nu; ++r) shifted.u(i)[r] += part * from_policy.u(j)[r];
    }
  }
}

// What each node's input may be: within the velocity limits, and within reach of the input that the
// last policy applies now by the acceleration limits over the time until the node and since the
// last call (so that call by call the first input changes as fast as the limits allow). Where both
// cannot be had, velocity wins.
void SlqSolver::Workspace::set_input_box(const SolveInput& input) noexcept {
  const int nu = problem->nu();
  const InputLimits& limits = problem->limits();
  double applied[kMaxInputs], x_ref[kMaxStates];
  if (last.nodes == 0 || !last.evaluate(input.t0, input.x0, applied, x_ref)) {
    std::fill_n(applied, nu, 0.0);
  }
  const double most_since = problem->grid()[1];
  const double since =
      last.nodes == 0 ? most_since : std::clamp(to_seconds(input.t0 - last.t_ns), 0.0, most_since);
  for (int i = 0; i + 1 < problem->nodes(); ++i) {
    lower[i].resize(nu);
    upper[i].resize(nu);
    for (int r = 0; r < nu; ++r) {
      const double most = input.reference->speed_scale * limits.velocity[r];
      const double from = std::clamp(applied[r], -limits.velocity[r], limits.velocity[r]);
      const double change = problem->solver().acceleration_fraction * limits.acceleration[r] *
                            (problem->grid()[i] + since);
      lower[i][r] = std::clamp(from - change, -most, most);
      upper[i][r] = std::clamp(from + change, -most, most);
    }
  }
}

// Cost of node i at (x, u), recorded in the trajectory.
double SlqSolver::Workspace::visit(int i, const StateVector& x, const InputVector* u,
                                   Quadratic* quadratic, Trajectory& trajectory) noexcept {
  node.sample = &samples[i];
  node.terminal = u == nullptr;
  node.x = x;
  if (u) node.u = *u;
  std::array<double, kMaxTerms> term_cost;
  const double weight = problem->weight_s(i);
  const double cost = weight * problem->evaluate(node, quadratic, term_cost.data());
  for (std::size_t k = 0; k < problem->terms().size(); ++k) {
    trajectory.term_cost[k] += weight * term_cost[k];
  }
  if (quadratic) {
    quadratic->q *= weight;
    quadratic->Q *= weight;
    quadratic->r *= weight;
    quadratic->R *= weight;
  }
  trajectory.cost += cost;
  return cost;
}

// Rolls the shifted policy out from x0 and makes the quadratic problem about the result.
bool SlqSolver::Workspace::linearise_warm_start(const SolveInput& input) noexcept {
  const int steps = problem->nodes() - 1, nx = problem->nx();
  now->cost = 0;
  now->term_cost.fill(0.0);
  node.active_spheres = 0;
  now->x[0] = Eigen::Map<const Eigen::VectorXd>(input.x0, nx);
  for (int i = 0; i < steps; ++i) {
    LqStage& stage = stages[i];
    now->u[i] = shifted.u(i);
    now->u[i].noalias() += shifted.K(i).lazyProduct(now->x[i] - shifted.x(i));
    now->u[i] = now->u[i].cwiseMax(lower[i]).cwiseMin(upper[i]);
    if (!std::isfinite(visit(i, now->x[i], &now->u[i], &stage.cost, *now))) return false;
    const double dt = problem->weight_s(i);
    problem->step_derivatives(now->x[i].data(), now->u[i].data(), dt, stage.A, stage.B);
    stage.lower = lower[i] - now->u[i];
    stage.upper = upper[i] - now->u[i];
    stage.k.setZero(problem->nu());
    now->x[i + 1].resize(nx);
    problem->step(now->x[i].data(), now->u[i].data(), dt, now->x[i + 1].data());
  }
  visit(steps, now->x[steps], nullptr, &terminal, *now);
  now->active_spheres = node.active_spheres;
  return std::isfinite(now->cost);
}

// Linearises about the better warm start of the two: the last policy shifted, or the guess. A line
// search never leaves the valley that it starts in; a guess that follows the reference leads out of
// one that the reference has left.
bool SlqSolver::Workspace::start(const SolveInput& input) noexcept {
  double guessed = std::numeric_limits<double>::infinity();
  const bool have_guess = input.guess && input.guess->nodes > 1 &&
                          input.guess->states == problem->nx() &&
                          input.guess->inputs == problem->nu();
  if (have_guess) {
    shift(*input.guess, input);
    if (linearise_warm_start(input)) guessed = now->cost;
  }
  shift(last, input);
  const bool finite = linearise_warm_start(input);
  if (finite && !(guessed < now->cost)) return true;
  if (!std::isfinite(guessed)) return false;
  shift(*input.guess, input);
  return linearise_warm_start(input);
}

// Rolls out u = u_now + length k + K (x - x_now) within the box into `next`. Gives up once the cost
// exceeds `worst`.
double SlqSolver::Workspace::roll_out(double length, double worst) noexcept {
  const int steps = problem->nodes() - 1;
  next->cost = 0;
  next->term_cost.fill(0.0);
  node.active_spheres = 0;
  next->x[0] = now->x[0];
  for (int i = 0; i < steps; ++i) {
    const LqStage& stage = stages[i];
    next->u[i] = now->u[i] + length * stage.k;
    next->u[i].noalias() += stage.K.lazyProduct(next->x[i] - now->x[i]);
    next->u[i] = next->u[i].cwiseMax(lower[i]).cwiseMin(upper[i]);
    visit(i, next->x[i], &next->u[i], nullptr, *next);
    if (!(next->cost <= worst)) return std::numeric_limits<double>::infinity();
    next->x[i + 1].resize(problem->nx());
    problem->step(next->x[i].data(), next->u[i].data(), problem->weight_s(i),
                  next->x[i + 1].data());
  }
  visit(steps, next->x[steps], nullptr, nullptr, *next);
  next->active_spheres = node.active_spheres;
  return next->cost;
}

void SlqSolver::Workspace::publish(const SolveInput& input, const Trajectory& trajectory,
                                   bool new_gains, Policy& policy) noexcept {
  if (new_gains) {
    for (int i = 0; i < problem->nodes(); ++i) {
      shifted.x(i) = trajectory.x[i];
      if (i + 1 == problem->nodes()) break;
      shifted.u(i) = trajectory.u[i];
      shifted.K(i) = stages[i].K;
    }
  }
  shifted.seq = ++solves;
  shifted.t_ns = input.t0;
  shifted.reference_seq = input.reference->seq;
  shifted.field_seq = input.field && !input.field->empty() ? input.field->seq : 0;
  copy(shifted, last);
  copy(shifted, policy);
}

SolveStatus SlqSolver::Workspace::solve(const SolveInput& input, Policy& policy,
                                        SolveReport& report) noexcept {
  report = {};
  report.nodes = problem->nodes();
  for (int i = 0; i < problem->nodes(); ++i) t[i] = input.t0 + from_seconds(problem->grid()[i]);

  LqResult lq;
  if (prepare(input)) {
    set_input_box(input);
    if (start(input)) lq = solve_lq(stages, terminal, regularisation);
  }
  if (!lq.finite) {
    shift(last, input);
    publish(input, *now, false, policy);
    return report.status = SolveStatus::kNotFinite;
  }

  const double before = now->cost;
  double length = 1.0;
  for (int i = 0; i < problem->solver().line_search_steps; ++i, length *= 0.5) {
    ++report.line_search_steps;
    const double promised = length * lq.linear + 0.5 * length * length * lq.quadratic;
    const double worst = before + kArmijo * std::min(0.0, promised) + kRounding * (1.0 + before);
    if (roll_out(length, worst) <= worst) {
      std::swap(now, next);
      report.step = length;
      break;
    }
  }
  if (report.step == 1.0) {
    regularisation /= kRegularisationFactor;
    if (regularisation < kRegularisationFirst) regularisation = 0;
  } else if (report.step == 0.0) {
    regularisation = std::clamp(kRegularisationFactor * regularisation, kRegularisationFirst,
                                kRegularisationMost);
  }
  publish(input, *now, true, policy);
  report.cost_before = before;
  report.cost_after = now->cost;
  report.term_cost = now->term_cost;
  report.active_environment_spheres = std::popcount(now->active_spheres);
  report.status = report.step > 0 ? SolveStatus::kConverging : SolveStatus::kNoStep;
  return report.status;
}

}  // namespace wb
