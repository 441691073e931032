// One named part of the MPC's cost: what every term is handed at a node, and what it adds there.
// Step world: evaluate() is noexcept, pure and allocates nothing. x = (base x, y, yaw; q), u = (v,
// w; dq), frame W, SI. No term couples x with u, so the Gauss-Newton Hessian is the two blocks Q
// and R. Source: Mittal et al. 2022, Sec. IV; DESIGN.md, "Formulation of the MPC".
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
inline constexpr int kMaxSpheres = 64;  // bits of Node::active_spheres

using InputVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxInputs, 1>;
using StateMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxStates>;
using InputMatrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxInputs, kMaxInputs>;

// A node of the horizon with what the terms share: the kinematics are computed once for all of
// them.
struct Node {
  const Reference* reference = nullptr;
  const DistanceField* field = nullptr;  // may be null
  const ReferenceSample* sample = nullptr;
  bool terminal = false;  // no input
  StateVector x;
  InputVector u;
  RobotModel::Data kinematics;
  std::uint64_t active_spheres = 0;  // written by the environment term, one bit a sphere
};

// Quadratic model about a node: cost(x + dx, u + du) ~ cost + q'dx + dx'Q dx / 2 + r'du + du'R du
// / 2.
struct Quadratic {
  StateVector q;
  StateMatrix Q;
  InputVector r;
  InputMatrix R;

  void set_zero(int states, int inputs) {
    q.setZero(states);
    Q.setZero(states, states);
    r.setZero(inputs);
    R.setZero(inputs, inputs);
  }
};

enum class TermKind { kCost, kSoftInequality };
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
  // is not null.
  virtual double evaluate(Node& node, Quadratic* quadratic) const noexcept = 0;

 private:
  std::string name_;
  TermKind kind_;
  TermScope scope_;
};

}  // namespace wb
