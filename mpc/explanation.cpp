#include "mpc/explanation.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <stdexcept>

namespace wb {
namespace {

// What one term says along the policy.
struct Slopes {
  TermPull pull;
  bool of_state = false;                  // some state gradient is not zero
  std::vector<StateVector> q;             // weighted by the nodes' seconds
  std::vector<InputVector> along_inputs;  // r, then the reduced gradient
  std::uint64_t spheres = 0;              // the environment's active ones
};

std::string words(const Slopes& a, const Slopes& b, double cosine) {
  char text[160];
  std::snprintf(text, sizeof text, "%s pulls against %s (cosine %.2f)", a.pull.name.c_str(),
                b.pull.name.c_str(), cosine);
  std::string out = text;
  const char* separator = ": ";
  for (const Slopes* s : {&a, &b}) {
    if (const int spheres = std::popcount(s->spheres)) {
      out += separator + std::to_string(spheres) + (spheres == 1 ? " sphere" : " spheres") +
             " of the robot close to an obstacle";
      separator = ", ";
    }
    if (s->pull.violation > 0) {
      std::snprintf(text, sizeof text, "%s%s violated by %.3g", separator, s->pull.name.c_str(),
                    s->pull.violation);
      out += text;
      separator = ", ";
    }
  }
  return out;
}

}  // namespace

Explanation explain(const OptimalControlProblem& problem, const Reference& reference,
                    const DistanceField* field, const Weights& weights, const Policy& policy) {
  const int nx = problem.nx(), nu = problem.nu(), nodes = policy.nodes;
  if (nodes < 2 || nodes > kMaxNodes || policy.states != nx || policy.inputs != nu)
    throw std::invalid_argument("explain: the policy is empty or of another robot");

  const auto& terms = problem.terms();
  std::vector<Slopes> slopes(terms.size());
  std::vector<StateMatrix> A(nodes - 1);
  std::vector<StateInputMatrix> B(nodes - 1);
  std::vector<double> dt(nodes - 1);
  Node node;
  node.reference = &reference;
  node.field = field;
  node.weights = weights.values.data();
  for (int k = 0; k < nodes; ++k) {
    node.terminal = k + 1 == nodes;
    const ReferenceSample at = sample(reference, policy.t[k]);
    node.sample = &at;
    node.x = policy.x(k);
    if (!node.terminal) {
      node.u = policy.u(k);
      dt[k] = to_seconds(policy.t[k + 1] - policy.t[k]);
      problem.step_derivatives(node.x.data(), node.u.data(), dt[k], A[k], B[k]);
    }
    problem.model().forward_kinematics(node.x.data(), node.kinematics);
    const double weight_s = node.terminal ? problem.weight_s(problem.nodes() - 1) : dt[k];
    for (std::size_t i = 0; i < terms.size(); ++i) {
      Slopes& s = slopes[i];
      s.pull.name = terms[i]->name();
      Quadratic quadratic;
      quadratic.set_zero(nx, nu);
      node.violation = 0;
      node.active_spheres = 0;
      if (!node.terminal || terms[i]->scope() != TermScope::kStage)
        s.pull.cost += weight_s * terms[i]->evaluate(node, &quadratic);
      s.pull.violation = std::max(s.pull.violation, node.violation);
      s.spheres |= node.active_spheres;
      s.of_state = s.of_state || (quadratic.q.array() != 0.0).any();
      s.q.push_back(weight_s * quadratic.q);
      s.along_inputs.push_back(weight_s * quadratic.r);
    }
  }

  Explanation out;
  for (Slopes& s : slopes) {
    StateVector lambda = s.q[nodes - 1];
    s.along_inputs.pop_back();
    for (int k = nodes - 2; k >= 0; --k) {
      InputVector& slope = s.along_inputs[k];
      slope += B[k].transpose() * lambda;
      lambda = (s.q[k] + A[k].transpose() * lambda).eval();
      // Inputs in fractions of their limits; of a function of time, whatever the grid.
      slope = slope.cwiseProduct(problem.limits().velocity) / std::sqrt(dt[k]);
      s.pull.pull += slope.squaredNorm();
    }
    s.pull.pull = std::sqrt(s.pull.pull);
    out.cost += s.pull.cost;
  }
  double largest = 0;
  for (Slopes& s : slopes) {
    s.pull.share = out.cost > 0 ? s.pull.cost / out.cost : 0.0;
    largest = std::max(largest, s.pull.pull);
    out.terms.push_back(s.pull);
  }
  const auto compared = [&](std::size_t i) {
    const Slopes& s = slopes[i];
    const bool satisfied = terms[i]->kind() == TermKind::kCost && s.pull.share < kSatisfied;
    return s.of_state && !satisfied && s.pull.pull >= kLarge * largest && s.pull.pull > 0;
  };
  out.cosine.assign(terms.size(), std::vector<double>(terms.size(), 0.0));
  for (std::size_t i = 0; i < terms.size(); ++i) {
    for (std::size_t j = 0; j < terms.size(); ++j) {
      const double norms = slopes[i].pull.pull * slopes[j].pull.pull;
      if (!(norms > 0)) continue;
      double product = 0;
      for (int k = 0; k + 1 < nodes; ++k)
        product += slopes[i].along_inputs[k].dot(slopes[j].along_inputs[k]);
      const double cosine = out.cosine[i][j] = product / norms;
      if (i < j && cosine < kOpposed && compared(i) && compared(j)) {
        out.competing.push_back({words(slopes[i], slopes[j], cosine), static_cast<int>(i),
                                 static_cast<int>(j), cosine});
      }
    }
  }
  std::sort(out.competing.begin(), out.competing.end(),
            [](const Competition& a, const Competition& b) { return a.cosine < b.cosine; });
  return out;
}

}  // namespace wb
