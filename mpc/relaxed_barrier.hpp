// Penalty of a soft inequality z >= 0: a log barrier that fades out at `reach` and turns quadratic
// below `delta`. Step world, any thread. With s = z / reach, between delta and reach: -mu (ln s +
// (1 - s) + (1 - s)^2 / 2); zero with two zero derivatives from reach on, so what is far away costs
// nothing and biases nothing; below delta the quadratic of equal value, slope and curvature. Convex
// and never negative. Source: Feller and Ebenbauer 2017 (relaxed logarithmic barriers).
#pragma once
#include <cmath>

namespace wb {

struct RelaxedBarrier {
  double mu = 0;     // cost
  double delta = 0;  // unit of z, 0 < delta < reach
  double reach = 0;  // unit of z

  struct Value {
    double value = 0, slope = 0, curvature = 0;
  };

  // A z that is not a number yields a value that is not a number.
  Value at(double z) const noexcept {
    if (z >= reach) return {};
    const double s = (z > delta ? z : delta) / reach;
    const double gap = 1.0 - s;
    Value v{-mu * (std::log(s) + gap + 0.5 * gap * gap), -mu * gap * gap / (s * reach),
            mu * (1.0 / (s * s) - 1.0) / (reach * reach)};
    if (z > delta) return v;
    const double below = z - delta;
    return {v.value + (v.slope + 0.5 * v.curvature * below) * below, v.slope + v.curvature * below,
            v.curvature};
  }
};

}  // namespace wb
