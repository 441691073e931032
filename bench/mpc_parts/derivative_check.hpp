// Every term's derivatives against central differences (Richardson's extrapolation of two steps).
// Non-smooth places are left out and counted: where the two steps disagree by far more than
// curvature explains (voxel borders of the field, nearest features of capsules, half a turn of the
// orientation error, edges of masks).
#pragma once
#include "bench/mpc_parts/situation.hpp"

namespace wb::bench {

struct DerivativeCheck {
  double worst = 0;  // largest error over max(1, largest entry)
  int entries = 0, kinks = 0, samples_with_effect = 0;
};

inline DerivativeCheck check_derivatives(const OptimalControlProblem& problem, const Term& term,
                                         Situations& situations, int samples) {
  constexpr double kStep = 2e-5;
  // Two steps of a smooth function differ by h^2 f''' / 8; that is below 2e-6 of the scale for f'''
  // up to 4e4 of it, which the barriers stay below.
  constexpr double kKink = 2e-6;
  DerivativeCheck out;
  Node node;
  Equality rows;
  const auto evaluate = [&](Quadratic* quadratic, Eigen::VectorXd& values) {
    problem.model().forward_kinematics(node.x.data(), node.kinematics);
    if (term.kind() == TermKind::kEquality) {
      rows.set_zero(problem.nx(), problem.nu());
      term.constrain(node, rows, quadratic != nullptr);
      values = rows.e.head(rows.rows);
    } else {
      if (quadratic) quadratic->set_zero(problem.nx(), problem.nu());
      values = Eigen::VectorXd::Constant(1, term.evaluate(node, quadratic));
    }
  };
  for (int s = 0; s < samples; ++s) {
    situations.randomise(node);
    Quadratic quadratic;
    Eigen::VectorXd values;
    evaluate(&quadratic, values);
    Eigen::MatrixXd analytic(values.size(), problem.nx() + problem.nu());
    if (term.kind() == TermKind::kEquality) {
      analytic << rows.C.topRows(rows.rows), rows.D.topRows(rows.rows);
    } else {
      analytic << quadratic.q.transpose(), quadratic.r.transpose();
    }
    if (values.size() == 0) continue;
    out.samples_with_effect += analytic.norm() > 0;
    const double scale = std::max(1.0, analytic.lpNorm<Eigen::Infinity>());
    for (int c = 0; c < analytic.cols(); ++c) {
      double& variable = c < problem.nx() ? node.x[c] : node.u[c - problem.nx()];
      const double at = variable;
      Eigen::VectorXd difference[2];
      for (int half = 0; half < 2; ++half) {
        const double h = half ? 0.5 * kStep : kStep;
        Eigen::VectorXd ahead, behind;
        variable = at + h;
        evaluate(nullptr, ahead);
        variable = at - h;
        evaluate(nullptr, behind);
        difference[half] = (ahead - behind) / (2 * h);
      }
      variable = at;
      for (int r = 0; r < values.size(); ++r, ++out.entries) {
        if (std::abs(difference[0][r] - difference[1][r]) > kKink * scale) {
          ++out.kinks;
          continue;
        }
        const double slope = (4 * difference[1][r] - difference[0][r]) / 3;
        out.worst = std::max(out.worst, std::abs(analytic(r, c) - slope) / scale);
      }
    }
  }
  return out;
}

}  // namespace wb::bench
