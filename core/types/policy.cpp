#include "core/types/policy.hpp"

#include <algorithm>

namespace wb {

bool Policy::evaluate(TimeNs now, const double* x_now, double* u_out,
                      double* x_ref_out) const noexcept {
  Eigen::Map<Eigen::VectorXd> u_now(u_out, inputs), x_ref(x_ref_out, states);
  if (nodes < 2 || now >= t[nodes - 1]) {
    u_now.setZero();
    if (nodes > 0) {
      x_ref = x(nodes - 1);
    } else {
      x_ref.setZero();
    }
    return false;
  }
  // The last node at or before now; now before the first node uses the first.
  const auto after = std::upper_bound(t.begin(), t.begin() + nodes, now);
  const int i = std::max(0, static_cast<int>(after - t.begin()) - 1);
  const double span = static_cast<double>(t[i + 1] - t[i]);
  const double s = std::clamp(static_cast<double>(now - t[i]) / span, 0.0, 1.0);
  for (int k = 0; k < states; ++k) x_ref[k] = (1.0 - s) * x(i)[k] + s * x(i + 1)[k];
  for (int r = 0; r < inputs; ++r) {
    double value = u(i)[r];
    for (int c = 0; c < states; ++c) value += K(i)(r, c) * (x_now[c] - x_ref[c]);
    u_now[r] = value;
  }
  return true;
}

}  // namespace wb
