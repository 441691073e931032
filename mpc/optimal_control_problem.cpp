#include "mpc/optimal_control_problem.hpp"

#include <algorithm>
#include <cmath>

#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

using Factory = std::unique_ptr<Term> (*)(const config::Section&, const ModelPtr&, WeightTable&);

struct Entry {
  const char* name;
  Factory make;
};

// The one list of terms: name (also the section's name in mpc.yaml) and maker.
constexpr Entry kRegistry[] = {
    {"input", make_input_term},
    {"end_effector", make_end_effector_term},
    {"twist", make_twist_term},
    {"wrench", make_wrench_term},
    {"velocity_constraint", make_velocity_constraint_term},
    {"posture", make_posture_term},
    {"base_route", make_base_route_term},
    {"joint_limits", make_joint_limits_term},
    {"velocity_limits", make_velocity_limits_term},
    {"self_collision", make_self_collision_term},
    {"environment", make_environment_term},
    {"stability", make_stability_term},
};
static_assert(std::size(kRegistry) <= kMaxTerms);

// Displacement of an arc of chord angle h = w dt / 2: v dt sinc(h), turned to the heading at half
// time. It holds for a sideways v, too.
struct Sinc {
  double value, slope;
};
Sinc sinc(double h) {
  // The series' next terms are below 1e-16 and 1e-13 at the switch.
  if (std::abs(h) < 1e-3) return {1.0 - h * h / 6.0, -h / 3.0 + h * h * h / 30.0};
  return {std::sin(h) / h, (h * std::cos(h) - std::sin(h)) / (h * h)};
}

// Of a solver; a Policy carries the first kMaxNodes of them.
constexpr std::size_t kMaxGrid = 1024;

GridSettings read_grid(const config::Section& section) {
  const GridSettings grid{section.number("fine_step_s", {0.001, 1.0}),
                          section.number("fine_until_s", config::kPositive),
                          section.number("coarse_step_s", {0.001, 1.0}),
                          section.number("horizon_s", config::kPositive)};
  section.finish();
  return grid;
}

std::vector<double> make_grid(const GridSettings& settings, const config::Section& section) {
  std::vector<double> grid;
  const auto append = [&](double from, double until, double step) {
    const int count = static_cast<int>(std::ceil((until - from) / step - 1e-9));
    for (int i = 0; i < count; ++i) grid.push_back(from + i * (until - from) / count);
  };
  const double fine_until = std::min(settings.fine_until_s, settings.horizon_s);
  append(0.0, fine_until, settings.fine_step_s);
  append(fine_until, settings.horizon_s, settings.coarse_step_s);
  grid.push_back(settings.horizon_s);
  if (grid.size() > kMaxGrid) {
    section.fail("horizon_s", "needs " + std::to_string(grid.size()) + " nodes, allowed: at most " +
                                  std::to_string(kMaxGrid));
  }
  return grid;
}

}  // namespace

OptimalControlProblem::OptimalControlProblem(std::shared_ptr<const RobotModel> model,
                                             const std::vector<std::string>& disabled)
    : OptimalControlProblem(model, config::Section::open(model->config().folder / "mpc.yaml"),
                            disabled) {}

OptimalControlProblem::OptimalControlProblem(std::shared_ptr<const RobotModel> model,
                                             const config::Section& settings,
                                             const std::vector<std::string>& disabled,
                                             const GridSettings* grid)
    : model_(std::move(model)), limits_(input_limits(*model_)) {
  if (model_->nx() > kMaxStates || model_->nu() > kMaxInputs) {
    throw config::ConfigError(model_->config().urdf.string() + ": has " +
                              std::to_string(model_->nx()) + " states, allowed: at most " +
                              std::to_string(kMaxStates));
  }
  const config::Section grid_section = settings.section("grid");
  const GridSettings from_file = read_grid(grid_section);
  grid_ = make_grid(grid ? *grid : from_file, grid_section);
  for (std::size_t i = 0; i + 1 < grid_.size(); ++i) weights_s_.push_back(grid_[i + 1] - grid_[i]);
  weights_s_.push_back(settings.number("terminal_weight_s", config::kNonNegative));

  const config::Section search = settings.section("solver");
  solver_.line_search_steps = search.integer("line_search_steps", {1, 20});
  solver_.line_search_ratio = search.number("line_search_ratio", {0.05, 0.9});
  solver_.equality_penalty = search.number("equality_penalty", config::kPositive);
  solver_.acceleration_fraction = search.number("acceleration_fraction", {0.01, 10.0});
  search.finish();

  const config::Section sections = settings.section("terms");
  for (const Entry& entry : kRegistry) {
    const config::Section section = sections.section(entry.name);
    const bool enabled = section.boolean_or("enabled", true) &&
                         std::find(disabled.begin(), disabled.end(), entry.name) == disabled.end();
    WeightTable ignored;
    std::unique_ptr<Term> term = entry.make(section, model_, enabled ? weights_ : ignored);
    if (!enabled) continue;
    if (term->kind() == TermKind::kEquality) equalities_.push_back(term.get());
    terms_.push_back(std::move(term));
  }
  sections.finish();
  settings.finish();
  for (const std::string& name : disabled) {
    const bool known = std::any_of(std::begin(kRegistry), std::end(kRegistry),
                                   [&](const Entry& entry) { return name == entry.name; });
    if (!known) throw config::ConfigError("MPC: there is no term '" + name + "' to disable");
  }
}

void OptimalControlProblem::step(const double* x, const double* u, double dt,
                                 double* x_next) const noexcept {
  int row = 0;
  if (model_->base_dof() > 0) {
    const int turn = model_->base_inputs() - 1;
    const double half = 0.5 * u[turn] * dt, reach = dt * sinc(half).value;
    const double cosine = std::cos(x[2] + half), sine = std::sin(x[2] + half);
    const double chord = u[0] * reach, side = turn == 2 ? u[1] * reach : 0.0;
    x_next[0] = x[0] + chord * cosine - side * sine;
    x_next[1] = x[1] + chord * sine + side * cosine;
    x_next[2] = x[2] + 2.0 * half;
    row = 3;
  }
  const double* rates = u + (nu() - model_->joints());
  for (int j = 0; j < model_->joints(); ++j) x_next[row + j] = x[row + j] + rates[j] * dt;
}

void OptimalControlProblem::step_derivatives(const double* x, const double* u, double dt,
                                             StateMatrix& A, StateInputMatrix& B) const noexcept {
  A.setIdentity(nx(), nx());
  B.setZero(nx(), nu());
  if (model_->base_dof() > 0) {
    const int turn = model_->base_inputs() - 1;
    const double half = 0.5 * u[turn] * dt;
    const Sinc s = sinc(half);
    const double cosine = std::cos(x[2] + half), sine = std::sin(x[2] + half);
    const double vx = u[0], vy = turn == 2 ? u[1] : 0.0, reach = dt * s.value;
    A(0, 2) = -reach * (vx * sine + vy * cosine);
    A(1, 2) = reach * (vx * cosine - vy * sine);
    B(0, 0) = reach * cosine;
    B(1, 0) = reach * sine;
    if (turn == 2) {
      B(0, 1) = -reach * sine;
      B(1, 1) = reach * cosine;
    }
    B(0, turn) = 0.5 * dt * (dt * s.slope * (vx * cosine - vy * sine) + A(0, 2));
    B(1, turn) = 0.5 * dt * (dt * s.slope * (vx * sine + vy * cosine) + A(1, 2));
    B(2, turn) = dt;
  }
  for (int j = 1; j <= model_->joints(); ++j) B(nx() - j, nu() - j) = dt;
}

double OptimalControlProblem::evaluate(Node& node, Quadratic* quadratic,
                                       TermValues* values) const noexcept {
  model_->forward_kinematics(node.x.data(), node.kinematics);
  if (quadratic) quadratic->set_zero(nx(), nu());
  double cost = 0;
  for (std::size_t i = 0; i < terms_.size(); ++i) {
    const bool skipped = node.terminal && terms_[i]->scope() == TermScope::kStage;
    node.violation = 0;
    const double value = skipped ? 0.0 : terms_[i]->evaluate(node, quadratic);
    if (values) {
      values->cost[i] = value;
      values->violation[i] = node.violation;
    }
    cost += value;
  }
  return cost;
}

void OptimalControlProblem::constrain(Node& node, Equality& equality,
                                      bool derivatives) const noexcept {
  equality.rows = 0;
  if (equalities_.empty() || node.terminal) return;
  if (derivatives) equality.set_zero(nx(), nu());
  for (const Term* term : equalities_) term->constrain(node, equality, derivatives);
}

}  // namespace wb
