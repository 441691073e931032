#include "mpc/reference_sample.hpp"

#include <algorithm>

namespace wb {
namespace {

// Keyframes on either side of t and how far t is from the first to the second, in [0, 1].
template <typename Keyframe>
struct Bracket {
  const Keyframe* before;
  const Keyframe* after;
  double fraction;
};

template <typename Keyframe, std::size_t N>
Bracket<Keyframe> bracket(const std::array<Keyframe, N>& keyframes, int count, TimeNs t) noexcept {
  const Keyframe* first = keyframes.data();
  const Keyframe* last = first + std::min(count, static_cast<int>(N)) - 1;
  const Keyframe* after = std::upper_bound(
      first, last + 1, t, [](TimeNs now, const Keyframe& k) { return now < k.t_ns; });
  if (after == first) return {first, first, 0.0};
  if (after > last) return {last, last, 0.0};
  const Keyframe* before = after - 1;
  return {before, after,
          static_cast<double>(t - before->t_ns) / static_cast<double>(after->t_ns - before->t_ns)};
}

Eigen::Quaterniond unit(const Pose& pose) noexcept {
  Eigen::Quaterniond q = pose.rotation();
  q.coeffs() /= q.norm();  // normalize() would let a zero pass for a rotation
  return q;
}

}  // namespace

bool ReferenceSample::finite() const {
  for (const PoseSample& pose : ee) {
    if (pose.active && !(pose.p_WE.allFinite() && pose.R_WE.allFinite())) return false;
  }
  return !has_base || base.allFinite();
}

ReferenceSample sample(const Reference& reference, TimeNs t) noexcept {
  ReferenceSample out;
  for (std::size_t k = 0; k < out.ee.size(); ++k) {
    const EndEffectorReference& ee = reference.ee[k];
    if (ee.count <= 0) continue;
    const auto [a, b, s] = bracket(ee.keyframes, ee.count, t);
    out.ee[k].active = true;
    out.ee[k].p_WE = (1.0 - s) * a->X_WE.position() + s * b->X_WE.position();
    out.ee[k].R_WE = unit(a->X_WE).slerp(s, unit(b->X_WE)).toRotationMatrix();
  }
  if (reference.base_count > 0) {
    const auto [a, b, s] = bracket(reference.base, reference.base_count, t);
    out.has_base = true;
    for (int i = 0; i < 3; ++i) out.base[i] = (1.0 - s) * a->base[i] + s * b->base[i];
  }
  return out;
}

}  // namespace wb
