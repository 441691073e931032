#include "mpc/slq_solver.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "mpc/plan.hpp"
#include "mpc/reference_sample.hpp"
#include "mpc/riccati.hpp"

namespace wb {
namespace {

// Part of the promised decrease that a step must deliver (Armijo), and what rounding may take from
// it.
constexpr double kArmijo = 1e-3;
constexpr double kRounding = 1e-12;

// Regularisation (an extra input weight, unit of R): zero while full steps are accepted; a call
// without a step raises it eightfold from kRegularisationFirst, a full step lowers it eightfold. A
// sweep that fails is tried once more with kRegularisationRetry times as much.
constexpr double kRegularisationFirst = 1e-2, kRegularisationMost = 1e2,
                 kRegularisationFactor = 8.0, kRegularisationRetry = 512.0;

// A horizon of fewer good nodes than this is not worth solving.
constexpr int kLeastNodes = 6;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Trajectory {
  std::vector<StateVector> x;
  std::vector<InputVector> u;
  TermValues terms;
  double cost = 0;
  double equality = 0, equality_sum = 0;  // largest |e|; integral of the sum of |e|
  std::uint64_t active_spheres = 0;

  Trajectory(int nodes, int states, int inputs)
      : x(nodes, StateVector::Zero(states)), u(nodes, InputVector::Zero(inputs)) {}
  void clear() {
    terms = {};
    cost = equality = equality_sum = 0;
    active_spheres = 0;
  }
};

}  // namespace

struct SlqSolver::Workspace {
  explicit Workspace(std::shared_ptr<const OptimalControlProblem> p)
      : problem(std::move(p)),
        nx(problem->nx()),
        nu(problem->nu()),
        t(problem->nodes()),
        samples(problem->nodes()),
        lower(problem->nodes(), InputVector::Zero(nu)),
        upper(problem->nodes(), InputVector::Zero(nu)),
        stages(problem->nodes() - 1),
        trajectories(3, Trajectory(problem->nodes(), nx, nu)),
        shifted(problem->nodes(), nx, nu),
        guessed(std::max(problem->nodes(), kMaxNodes), nx, nu),
        last(problem->nodes(), nx, nu),
        weights(problem->weights().configured()) {}

  SolveStatus solve(const SolveInput& input, Policy& policy, SolveReport& report) noexcept;
  void prepare(const SolveInput& input) noexcept;
  void set_input_box(const SolveInput& input) noexcept;
  bool start(const SolveInput& input) noexcept;
  int follow_plan(const SolveInput& input, bool derivatives, Trajectory& out) noexcept;
  bool solve_quadratic_problem() noexcept;
  void search(SolveReport& report) noexcept;
  void roll_out(double length) noexcept;
  bool visit(int i, Trajectory& trajectory, LqStage* stage) noexcept;
  void blame_node(int i, const Trajectory& trajectory) noexcept;
  SolveStatus keep_last(const SolveInput& input, Policy& policy, SolveReport& report) noexcept;
  void publish(const SolveInput& input, const Plan& plan, PolicyQuality quality,
               Policy& policy) noexcept;
  void blame(TroubleKind kind, int index, int at) noexcept {
    if (trouble.kind == TroubleKind::kNone)
      trouble = {kind, static_cast<std::int16_t>(index), static_cast<std::int16_t>(at)};
  }
  double merit(const Trajectory& trajectory) const noexcept {
    return trajectory.cost + problem->solver().equality_penalty * trajectory.equality_sum;
  }

  std::shared_ptr<const OptimalControlProblem> problem;
  const int nx, nu;
  std::vector<TimeNs> t;
  std::vector<ReferenceSample> samples;
  std::vector<InputVector> lower, upper;  // of the inputs
  std::vector<LqStage> stages;
  Quadratic terminal;
  Equality equality;
  Node node;
  std::vector<Trajectory> trajectories;
  Trajectory* now = &trajectories[0];    // about which the problem is linearised
  Trajectory* best = &trajectories[1];   // of the line search so far
  Trajectory* trial = &trajectories[2];  // of the line search
  Plan shifted;                          // a warm start on the new grid
  Plan guessed;                          // SolveInput::guess
  Plan last;                             // what was handed over; nodes = 0: none
  Weights weights;                       // in force

  int nodes = 0;         // of this solve: all, or those before the first trouble
  double cost_kept = 0;  // of the trajectory that the quadratic problem was made about
  LqResult lq;
  double regularisation = 0;
  Trouble trouble;
  int node_evaluations = 0, factorisations = 0;
  SolverCounters counters;

  // What the last policy before t0 applies there; kept while t0 stays the same.
  TimeNs applied_t = 0;
  bool have_applied = false;
  InputVector applied;
  double since_last = 0;
};

SlqSolver::SlqSolver(std::shared_ptr<const OptimalControlProblem> problem)
    : workspace_(std::make_unique<Workspace>(std::move(problem))) {}
SlqSolver::~SlqSolver() = default;

SolveStatus SlqSolver::solve(const SolveInput& input, Policy& policy, SolveReport& report) RT_SAFE {
  return workspace_->solve(input, policy, report);
}

int SlqSolver::converge(const SolveInput& input, int iterations, double tolerance, Policy& policy,
                        SolveReport& report) RT_SAFE {
  SolveInput again = input;
  for (int i = 1; i <= iterations; ++i) {
    const SolveStatus status = workspace_->solve(again, policy, report);
    again.guess = nullptr;
    if (status == SolveStatus::kNotFinite || report.largest_move <= tolerance) return i;
  }
  return iterations;
}

void SlqSolver::reset() RT_SAFE {
  workspace_->last.nodes = 0;
  workspace_->have_applied = false;
  workspace_->regularisation = 0;
}

const SolverCounters& SlqSolver::counters() const { return workspace_->counters; }

WorkBound SlqSolver::work_bound() const {
  const OptimalControlProblem& problem = *workspace_->problem;
  // Two warm starts, of which one is linearised; once more on a shortened horizon; the line search.
  const int rollouts = 4 + problem.solver().line_search_steps;
  WorkBound bound;
  bound.node_evaluations = rollouts * problem.nodes();
  bound.term_evaluations = bound.node_evaluations * static_cast<int>(problem.terms().size());
  bound.factorisations = 2 * kMaxStageFactorisations * (problem.nodes() - 1);
  return bound;
}

std::span<const StateVector> SlqSolver::states() const {
  return {workspace_->last.x.data(), static_cast<std::size_t>(workspace_->last.nodes)};
}
std::span<const InputVector> SlqSolver::inputs() const {
  return {workspace_->last.u.data(),
          static_cast<std::size_t>(std::max(0, workspace_->last.nodes - 1))};
}
ValueFunction SlqSolver::value_function() const {
  return {workspace_->cost_kept, workspace_->stages[0].v, workspace_->stages[0].V};
}

// Takes the weights, samples the reference at the nodes, and cuts the horizon where it is not a
// number.
void SlqSolver::Workspace::prepare(const SolveInput& input) noexcept {
  node.reference = input.reference;
  node.field = input.field;
  nodes = problem->nodes();
  trouble = {};
  if (!input.weights) {
    weights = problem->weights().configured();
  } else if (problem->weights().accepts(*input.weights)) {
    weights = *input.weights;
  } else {
    ++counters.refused_weights;
    int index = -1;
    const auto& infos = problem->weights().infos();
    for (std::size_t i = 0; i < infos.size() && index < 0; ++i) {
      const double w = input.weights->values[i];
      if (!(w >= infos[i].low && w <= infos[i].high)) index = static_cast<int>(i);
    }
    blame(TroubleKind::kWeights, index, -1);
  }
  node.weights = weights.values.data();
  for (int r = 0; r < nx; ++r) {
    if (std::isfinite(input.x0[r])) continue;
    trouble = {};
    blame(TroubleKind::kState, r, -1);
    nodes = 0;
  }
  if (!(input.reference->speed_scale > 0.0 && input.reference->speed_scale <= 1.0)) {
    blame(TroubleKind::kReference, -1, -1);
    nodes = 0;
  }
  for (int i = 0; i < nodes; ++i) {
    samples[i] = sample(*input.reference, t[i]);
    if (samples[i].finite()) continue;
    blame(TroubleKind::kReference, -1, i);
    nodes = i;
  }
}

// What each node's input may be: within the velocity limits, and within reach of the input that the
// last policy applies now by the acceleration limits over the time until the node and since the
// last call (so that call by call the first input changes as fast as the limits allow). Where both
// cannot be had, velocity wins.
void SlqSolver::Workspace::set_input_box(const SolveInput& input) noexcept {
  const InputLimits& limits = problem->limits();
  const double scale = input.reference->speed_scale > 0.0 && input.reference->speed_scale <= 1.0
                           ? input.reference->speed_scale
                           : 1.0;
  if (!have_applied || input.t0 != applied_t) {
    const double most_since = problem->grid()[1];
    since_last = last.nodes == 0 ? most_since
                                 : std::clamp(to_seconds(input.t0 - last.t[0]), 0.0, most_since);
    const StateVector x0 = Eigen::Map<const Eigen::VectorXd>(input.x0, nx);
    if (!x0.allFinite() || !last.evaluate(input.t0, x0, applied)) applied.setZero(nu);
    for (int r = 0; r < nu; ++r)
      applied[r] = std::clamp(applied[r], -limits.velocity[r], limits.velocity[r]);
    applied_t = input.t0;
    have_applied = true;
  }
  for (int i = 0; i + 1 < problem->nodes(); ++i) {
    for (int r = 0; r < nu; ++r) {
      const double most = scale * limits.velocity[r];
      const double change = problem->solver().acceleration_fraction * limits.acceleration[r] *
                            (problem->grid()[i] + since_last);
      lower[i][r] = std::clamp(applied[r] - change, -most, most);
      upper[i][r] = std::clamp(applied[r] + change, -most, most);
    }
  }
}

// Adds node i of a trajectory to its cost, and to a stage (the last node: `terminal`) what the
// quadratic problem needs of it. False if the cost is not a number.
bool SlqSolver::Workspace::visit(int i, Trajectory& trajectory, LqStage* stage) noexcept {
  ++node_evaluations;
  node.sample = &samples[i];
  node.terminal = i + 1 == nodes;
  node.x = trajectory.x[i];
  if (!node.terminal) node.u = trajectory.u[i];
  // A shortened horizon ends with the weight that the whole one ends with.
  const double weight = problem->weight_s(node.terminal ? problem->nodes() - 1 : i);
  Quadratic* quadratic = !stage ? nullptr : node.terminal ? &terminal : &stage->cost;
  TermValues values;
  const double cost = problem->evaluate(node, quadratic, &values);
  const std::size_t terms = problem->terms().size();
  for (std::size_t k = 0; k < terms; ++k) {
    trajectory.terms.cost[k] += weight * values.cost[k];
    trajectory.terms.violation[k] = std::max(trajectory.terms.violation[k], values.violation[k]);
  }
  if (quadratic) {
    quadratic->q *= weight;
    quadratic->Q *= weight;
    quadratic->r *= weight;
    quadratic->R *= weight;
    if (quadratic->coupled) quadratic->P *= weight;
  }
  if (!node.terminal && problem->has_equalities()) {
    Equality& rows = stage ? stage->equality : equality;
    problem->constrain(node, rows, stage != nullptr);
    for (int r = 0; r < rows.rows; ++r) {
      const double e = std::abs(rows.e[r]);
      trajectory.equality = std::max(trajectory.equality, e);
      trajectory.equality_sum += weight * e;
    }
  }
  trajectory.cost += weight * cost;
  return std::isfinite(trajectory.cost) && std::isfinite(trajectory.equality_sum);
}

// Rolls the shifted plan out from x0 within the box; with derivatives, makes the quadratic problem
// about the result. Returns how many nodes are numbers, and blames the first that is not.
int SlqSolver::Workspace::follow_plan(const SolveInput& input, bool derivatives,
                                      Trajectory& out) noexcept {
  out.clear();
  node.active_spheres = 0;
  out.x[0] = Eigen::Map<const Eigen::VectorXd>(input.x0, nx);
  for (int i = 0; i < nodes; ++i) {
    const bool last_node = i + 1 == nodes;
    if (!last_node) {
      out.u[i] = shifted.u[i];
      out.u[i].noalias() += shifted.K[i].lazyProduct(out.x[i] - shifted.x[i]);
      out.u[i] = out.u[i].cwiseMax(lower[i]).cwiseMin(upper[i]);
    }
    LqStage* stage = derivatives ? &stages[std::min(i, nodes - 2)] : nullptr;
    if (!visit(i, out, stage)) {
      blame_node(i, out);
      return i;
    }
    if (last_node) break;
    const double dt = problem->weight_s(i);
    problem->step(out.x[i].data(), out.u[i].data(), dt, out.x[i + 1].data());
    if (!stage) continue;
    problem->step_derivatives(out.x[i].data(), out.u[i].data(), dt, stage->A, stage->B);
    stage->lower = lower[i] - out.u[i];
    stage->upper = upper[i] - out.u[i];
    stage->k.setZero(nu);
  }
  out.active_spheres = node.active_spheres;
  return nodes;
}

// Names what is not a number at the node that was just visited.
void SlqSolver::Workspace::blame_node(int i, const Trajectory& trajectory) noexcept {
  if (!trajectory.x[i].allFinite()) return blame(TroubleKind::kModel, -1, i);
  for (std::size_t k = 0; k < problem->terms().size(); ++k) {
    Quadratic quadratic;
    quadratic.set_zero(nx, nu);
    const Term& term = *problem->terms()[k];
    if (node.terminal && term.scope() == TermScope::kStage) continue;
    const double cost = term.evaluate(node, &quadratic);
    if (!std::isfinite(cost + quadratic.q.sum() + quadratic.Q.sum() + quadratic.r.sum() +
                       quadratic.R.sum())) {
      return blame(TroubleKind::kTerm, static_cast<int>(k), i);
    }
  }
  blame(TroubleKind::kModel, -1, i);
}

// Linearises about the better warm start of the two: the last policy shifted, or the guess. A line
// search never leaves the valley that it starts in; a guess that follows the reference leads out of
// one that the reference has left.
bool SlqSolver::Workspace::start(const SolveInput& input) noexcept {
  bool from_guess = false;
  if (input.guess && input.guess->nodes > 1 && input.guess->states == nx &&
      input.guess->inputs == nu) {
    guessed.take(*input.guess);
    shift(guessed, t, nodes, input.x0, shifted);
    const double guess_cost = follow_plan(input, false, *best) == nodes ? merit(*best) : kInfinity;
    shift(last, t, nodes, input.x0, shifted);
    const double last_cost = follow_plan(input, false, *trial) == nodes ? merit(*trial) : kInfinity;
    from_guess = guess_cost < last_cost;
    trouble = trouble.kind == TroubleKind::kTerm || trouble.kind == TroubleKind::kModel
                  ? Trouble{}
                  : trouble;  // the linearisation says it again
  }
  for (int attempt = 0; attempt < 2 && nodes >= kLeastNodes; ++attempt) {
    shift(from_guess ? guessed : last, t, nodes, input.x0, shifted);
    const int good = follow_plan(input, true, *now);
    if (good == nodes) return true;
    nodes = good;
  }
  return false;
}

bool SlqSolver::Workspace::solve_quadratic_problem() noexcept {
  const std::span<LqStage> used(stages.data(), static_cast<std::size_t>(nodes - 1));
  lq = solve_lq(used, terminal, regularisation);
  factorisations += lq.factorisations;
  if (lq.finite) return true;
  ++counters.regularised;
  regularisation = std::min(kRegularisationMost,
                            kRegularisationRetry * std::max(regularisation, kRegularisationFirst));
  for (LqStage& stage : used) stage.k.setZero(nu);
  lq = solve_lq(used, terminal, regularisation);
  factorisations += lq.factorisations;
  if (lq.finite) return true;
  // A derivative that is not a number although the cost is one, or an overflow.
  const int i = std::max(0, lq.failed_stage);
  node.sample = &samples[i];
  node.terminal = false;
  node.x = now->x[i];
  node.u = now->u[i];
  (void)problem->evaluate(node, nullptr, nullptr);
  blame_node(i, *now);
  if (trouble.kind == TroubleKind::kModel) trouble = {TroubleKind::kInput, -1, trouble.node};
  return false;
}

// Rolls out u = u_now + length k + K (x - x_now) within the box into `trial`. A cost that is not a
// number ends it with an infinite one.
void SlqSolver::Workspace::roll_out(double length) noexcept {
  trial->clear();
  node.active_spheres = 0;
  trial->x[0] = now->x[0];
  for (int i = 0; i < nodes; ++i) {
    if (i + 1 < nodes) {
      const LqStage& stage = stages[i];
      trial->u[i] = now->u[i] + length * stage.k;
      trial->u[i].noalias() += stage.K.lazyProduct(trial->x[i] - now->x[i]);
      trial->u[i] = trial->u[i].cwiseMax(lower[i]).cwiseMin(upper[i]);
    }
    if (!visit(i, *trial, nullptr)) {
      trial->cost = kInfinity;
      return;
    }
    if (i + 1 < nodes)
      problem->step(trial->x[i].data(), trial->u[i].data(), problem->weight_s(i),
                    trial->x[i + 1].data());
  }
  trial->active_spheres = node.active_spheres;
}

// Tries every step length, so that the work does not depend on the data, and takes the best one
// that keeps its promise.
void SlqSolver::Workspace::search(SolveReport& report) noexcept {
  const double before = merit(*now);
  double best_merit = kInfinity, length = 1.0;
  TermValues shortest;
  for (int i = 0; i < problem->solver().line_search_steps; ++i) {
    roll_out(length);
    const double promised = length * lq.linear + 0.5 * length * length * lq.quadratic -
                            length * problem->solver().equality_penalty * now->equality_sum;
    const double worst = before + kArmijo * std::min(0.0, promised) + kRounding * (1.0 + before);
    const double reached = merit(*trial);
    shortest = trial->terms;
    if (reached <= worst && reached < best_merit) {
      best_merit = reached;
      report.step = length;
      std::swap(best, trial);
    }
    length *= problem->solver().line_search_ratio;
  }
  if (report.step > 0) {
    std::swap(now, best);
  } else {
    int rises = -1;
    double most = 0;
    for (std::size_t k = 0; k < problem->terms().size(); ++k) {
      const double rise = shortest.cost[k] - now->terms.cost[k];
      if (rise > most) {
        most = rise;
        rises = static_cast<int>(k);
      }
    }
    blame(TroubleKind::kDescent, rises, -1);
  }
  if (report.step == 1.0) {
    regularisation /= kRegularisationFactor;
    if (regularisation < kRegularisationFirst) regularisation = 0;
  } else if (report.step == 0.0) {
    regularisation = std::clamp(kRegularisationFactor * regularisation, kRegularisationFirst,
                                kRegularisationMost);
  }
}

void SlqSolver::Workspace::publish(const SolveInput& input, const Plan& plan, PolicyQuality quality,
                                   Policy& policy) noexcept {
  plan.hand_over(policy);
  policy.seq = counters.solves;
  policy.quality = quality;
  policy.t_ns = input.t0;
  policy.reference_seq = input.reference->seq;
  policy.field_seq = input.field && !input.field->empty() ? input.field->seq : 0;
}

// The last policy from now on, its inputs within today's limits.
SolveStatus SlqSolver::Workspace::keep_last(const SolveInput& input, Policy& policy,
                                            SolveReport& report) noexcept {
  ++counters.kept;
  shift(last, t, problem->nodes(), input.x0, shifted);
  for (int i = 0; i + 1 < shifted.nodes; ++i)
    shifted.u[i] = shifted.u[i].cwiseMax(lower[i]).cwiseMin(upper[i]);
  std::swap(shifted, last);
  publish(input, last, PolicyQuality::kKept, policy);
  report.nodes = last.nodes;
  return report.status = SolveStatus::kNotFinite;
}

SolveStatus SlqSolver::Workspace::solve(const SolveInput& input, Policy& policy,
                                        SolveReport& report) noexcept {
  report = {};
  ++counters.solves;
  node_evaluations = factorisations = 0;
  for (int i = 0; i < problem->nodes(); ++i) t[i] = input.t0 + from_seconds(problem->grid()[i]);

  prepare(input);
  set_input_box(input);
  const bool solved = start(input) && solve_quadratic_problem();
  if (solved) {
    cost_kept = now->cost;
    report.cost_before = now->cost;
    report.regularisation = regularisation;
    for (int i = 0; i + 1 < nodes; ++i)
      report.largest_move = std::max(report.largest_move, stages[i].k.lpNorm<Eigen::Infinity>());
    search(report);
  }
  report.node_evaluations = node_evaluations;
  report.term_evaluations = node_evaluations * static_cast<int>(problem->terms().size());
  report.factorisations = factorisations;
  report.trouble = trouble;
  report.weights_revision = weights.revision;
  if (!solved) return keep_last(input, policy, report);

  last.nodes = nodes;
  for (int i = 0; i < nodes; ++i) {
    last.t[i] = t[i];
    last.x[i] = now->x[i];
    if (i + 1 == nodes) break;
    last.u[i] = now->u[i];
    last.K[i] = stages[i].K;
  }
  const bool shortened = nodes < problem->nodes();
  publish(input, last, shortened ? PolicyQuality::kShortened : PolicyQuality::kFull, policy);
  report.nodes = nodes;
  report.cost_after = now->cost;
  report.equality = now->equality;
  report.terms = now->terms;
  report.active_environment_spheres = std::popcount(now->active_spheres);
  counters.no_step += report.step == 0;
  counters.shortened += shortened;
  report.status = report.step == 0 ? SolveStatus::kNoStep
                  : shortened      ? SolveStatus::kShortened
                                   : SolveStatus::kConverging;
  return report.status;
}

}  // namespace wb
