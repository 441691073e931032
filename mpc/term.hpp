// One named part of the MPC's problem: what every term is handed at a node, and what it adds there.
// Step world: evaluate() and constrain() are noexcept, pure and allocate nothing. x = (base x, y,
// yaw; q), u = (base inputs; dq), frame W, SI. Source: Mittal et al. 2022, Sec. IV; DESIGN.md,
// "Formulation of the MPC".
#pragma once
#include <cstdint>
#include <string>
#include <utility>

#include "core/model/robot_model.hpp"
#include "core/types/distance_field.hpp"
#include "core/types/reference.hpp"
#include "mpc/reference_sample.hpp"

namespace wb {

inline constexpr int kMaxTerms = 16;
inline constexpr int kMaxSpheres = 64;                          // bits of Node::active_spheres
inline constexpr int kMaxEqualities = kMaxVelocityConstraints;  // rows at a node

using InputVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxInputs, 1>;
using StateMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxStates>;
using InputMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxInputs, kMaxInputs>;
using InputStateMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxInputs, kMaxStates>;

// A node of the horizon with what the terms share: the kinematics are computed once for all of
// them.
struct Node {
  const Reference* reference = nullptr;
  const DistanceField* field = nullptr;  // may be null
  const ReferenceSample* sample = nullptr;
  const double* weights = nullptr;  // Weights::values
  bool terminal = false;            // no input
  StateVector x;
  InputVector u;
  RobotModel::Data kinematics;
  double violation = 0;              // a soft inequality raises it to its largest -z, in z's unit
  std::uint64_t active_spheres = 0;  // written by the environment term, one bit a sphere
};

// Quadratic model about a node: cost(x + dx, u + du) ~ cost + q'dx + dx'Q dx / 2 + r'du + du'R du
// / 2 + du'P dx.
struct Quadratic {
  StateVector q;
  StateMatrix Q;
  InputVector r;
  InputMatrix R;
  bool coupled = false;  // P is set
  InputStateMatrix P;

  void set_zero(int states, int inputs) {
    q.setZero(states);
    Q.setZero(states, states);
    r.setZero(inputs);
    R.setZero(inputs, inputs);
    coupled = false;
  }
  // Before a term adds to P.
  void couple() {
    if (!coupled) P.setZero(r.size(), q.size());
    coupled = true;
  }
};

// Rows of e + C dx + D du = 0 about a node.
struct Equality {
  int rows = 0;
  Eigen::Matrix<double, kMaxEqualities, 1> e;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxEqualities, kMaxStates> C;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxEqualities, kMaxInputs> D;

  void set_zero(int states, int inputs) {
    rows = 0;
    C.setZero(kMaxEqualities, states);
    D.setZero(kMaxEqualities, inputs);
  }
};

enum class TermKind { kCost, kSoftInequality, kEquality };
enum class TermScope { kStage, kStageAndTerminal };

class Term {
 public:
  Term(std::string name, TermKind kind, TermScope scope)
      : name_(std::move(name)), kind_(kind), scope_(scope) {}
  virtual ~Term() = default;

  const std::string& name() const { return name_; }
  TermKind kind() const { return kind_; }
  TermScope scope() const { return scope_; }

  // Cost at the node; never negative. Adds gradient and Gauss-Newton Hessian to `quadratic` if it
  // is not null. An equality has none.
  virtual double evaluate(Node& node, Quadratic* quadratic) const noexcept { return 0.0; }
  // Equalities append their rows; with `derivatives` false only e.
  virtual void constrain(Node& node, Equality& equality, bool derivatives) const noexcept {}

 private:
  std::string name_;
  TermKind kind_;
  TermScope scope_;
};

}  // namespace wb
