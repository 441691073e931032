// What the MPC minimises: a time grid, the robot's kinematic model of motion, and one ordered list
// of named terms. Setup world to build (throws config::ConfigError), step world to use: every const
// method is noexcept and allocates nothing. x = (base x, y [m], yaw [rad]; q), u = (v [m/s], w
// [rad/s]; dq), of an omnidirectional base (vx, vy, w; dq); a fixed base has only q and dq. Source:
// Mittal et al. 2022, Sec. IV; DESIGN.md, "Formulation of the MPC".
#pragma once
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/config/config.hpp"
#include "core/model/robot_model.hpp"
#include "core/types/limits.hpp"
#include "mpc/input_limits.hpp"
#include "mpc/term.hpp"
#include "mpc/weight_table.hpp"

namespace wb {

using StateInputMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxInputs>;

// How the solver searches; from mpc.yaml.
struct SolverSettings {
  int line_search_steps = 3;         // lengths tried in every iteration; the best one is taken
  double line_search_ratio = 0.3;    // of a length to the one before it; the first is 1
  double acceleration_fraction = 1;  // of the acceleration limits that a policy may use
  double equality_penalty = 0;       // cost per violation and second, in the merit only
};

// What the terms say at a node or over a horizon, by the problem's term index.
struct TermValues {
  std::array<double, kMaxTerms> cost{};
  std::array<double, kMaxTerms> violation{};  // largest, in the term's own unit; 0: none
};

// Node spacing: `fine_step_s` until `fine_until_s`, then `coarse_step_s` until `horizon_s`.
struct GridSettings {
  double fine_step_s, fine_until_s, coarse_step_s, horizon_s;
};

class OptimalControlProblem {
 public:
  // Reads mpc.yaml in the robot's folder. Terms named in `disabled` are left out; an unknown name
  // is an error.
  explicit OptimalControlProblem(std::shared_ptr<const RobotModel> model,
                                 const std::vector<std::string>& disabled = {});
  // `grid`, if not null, stands for the file's.
  OptimalControlProblem(std::shared_ptr<const RobotModel> model, const config::Section& settings,
                        const std::vector<std::string>& disabled = {},
                        const GridSettings* grid = nullptr);

  const RobotModel& model() const { return *model_; }
  int nx() const { return model_->nx(); }
  int nu() const { return model_->nu(); }
  const InputLimits& limits() const { return limits_; }
  const SolverSettings& solver() const { return solver_; }

  // Node times [s] after the start, ascending from 0. The input of node i acts until node i + 1;
  // the last node has none.
  std::span<const double> grid() const { return grid_; }
  int nodes() const { return static_cast<int>(grid_.size()); }
  // Seconds that a node's running cost counts for: its interval, for the last node the configured
  // terminal weight.
  double weight_s(int node) const { return weights_s_[node]; }

  // Those that are enabled, in the order of TermValues.
  std::span<const std::unique_ptr<Term>> terms() const { return terms_; }
  const WeightTable& weights() const { return weights_; }
  bool has_equalities() const { return !equalities_.empty(); }

  // Where x is after `dt` seconds of constant u: exact, a straight line or an arc. Arrays of nx()
  // and nu() entries.
  void step(const double* x, const double* u, double dt, double* x_next) const noexcept;
  // Its derivatives A (nx x nx) and B (nx x nu).
  void step_derivatives(const double* x, const double* u, double dt, StateMatrix& A,
                        StateInputMatrix& B) const noexcept;

  // Cost rate [1/s] at a node whose x, u, reference, field, sample and weights are set; sets its
  // kinematics. `quadratic`, if not null, receives gradient and Hessian; `values`, if not null, one
  // entry per term.
  double evaluate(Node& node, Quadratic* quadratic, TermValues* values) const noexcept;
  // The equalities' rows at a node that was evaluated; none at a terminal one.
  void constrain(Node& node, Equality& equality, bool derivatives) const noexcept;

 private:
  std::shared_ptr<const RobotModel> model_;
  InputLimits limits_;
  SolverSettings solver_;
  std::vector<double> grid_, weights_s_;
  WeightTable weights_;
  std::vector<std::unique_ptr<Term>> terms_;
  std::vector<const Term*> equalities_;
};

}  // namespace wb
