#include "mpc/riccati.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace wb {
namespace {

// Matrices of a compiled-in size, or of a run-time size within the project's bounds.
template <int Rows, int Cols, int MaxRows, int MaxCols>
using Sized = Eigen::Matrix<double, Rows, Cols, 0, Rows == Eigen::Dynamic ? MaxRows : Rows,
                            Cols == Eigen::Dynamic ? MaxCols : Cols>;

template <int NX, int NU>
class Sweep {
 public:
  using XX = Sized<NX, NX, kMaxStates, kMaxStates>;
  using XU = Sized<NX, NU, kMaxStates, kMaxInputs>;
  using UX = Sized<NU, NX, kMaxInputs, kMaxStates>;
  using UU = Sized<NU, NU, kMaxInputs, kMaxInputs>;
  using X = Sized<NX, 1, kMaxStates, 1>;
  using U = Sized<NU, 1, kMaxInputs, 1>;
  template <typename T>
  using View = Eigen::Map<const T>;

  Sweep(int nx, int nu) : nx_(nx), nu_(nu) {}

  LqResult run(std::span<LqStage> stages, const Quadratic& terminal,
               double regularisation) noexcept {
    LqResult result;
    V_ = View<XX>(terminal.Q.data(), nx_, nx_);
    v_ = View<X>(terminal.q.data(), nx_);
    for (int i = static_cast<int>(stages.size()) - 1; i >= 0; --i) {
      LqStage& stage = stages[i];
      const View<XX> A(stage.A.data(), nx_, nx_);
      const View<XU> B(stage.B.data(), nx_, nu_);
      const XX VA = V_ * A;
      const XU VB = V_ * B;
      H_ = View<UU>(stage.cost.R.data(), nu_, nu_);
      H_.diagonal().array() += regularisation;
      H_.noalias() += B.transpose() * VB;
      G_.noalias() = B.transpose() * VA;
      g_ = View<U>(stage.cost.r.data(), nu_);
      g_.noalias() += B.transpose() * v_;
      if (!solve_box(stage)) return result;
      const Eigen::Map<U> k(stage.k.data(), nu_);
      const Eigen::Map<UX> K(stage.K.data(), nu_, nx_);
      result.linear += g_.dot(k);
      const U Hk = H_ * k;
      result.quadratic += k.dot(Hk);
      // With K zero at the bounds and optimal elsewhere, K'HK = -K'G and K'(Hk + g) = 0.
      next_ = View<XX>(stage.cost.Q.data(), nx_, nx_);
      next_.noalias() += A.transpose() * VA;
      next_.noalias() += G_.transpose() * K;
      const X v_next = A.transpose() * v_ + G_.transpose() * k;
      v_ = View<X>(stage.cost.q.data(), nx_) + v_next;
      V_ = 0.5 * (next_ + next_.transpose());
    }
    result.finite =
        std::isfinite(result.linear) && std::isfinite(result.quadratic) && v_.allFinite();
    return result;
  }

 private:
  // Projected Newton: k = argmin k'Hk / 2 + g'k within the box, and K for the inputs that are free
  // there.
  bool solve_box(LqStage& stage) noexcept {
    constexpr int kMaxIterations = 10, kMaxHalvings = 8;
    stage.k.conservativeResize(nu_);
    stage.K.resize(nu_, nx_);
    Eigen::Map<U> k(stage.k.data(), nu_);
    const View<U> lower(stage.lower.data(), nu_), upper(stage.upper.data(), nu_);
    k = k.cwiseMax(lower).cwiseMin(upper);
    U slope = H_ * k + g_;
    const double tolerance = 1e-10 * (1.0 + g_.template lpNorm<Eigen::Infinity>());
    bool held[kMaxInputs] = {};
    bool factorised = false;
    for (int iteration = 0;; ++iteration) {
      double free_slope = 0;
      for (int i = 0; i < nu_; ++i) {
        const bool hold = (k[i] <= lower[i] && slope[i] > 0) || (k[i] >= upper[i] && slope[i] < 0);
        factorised &= hold == held[i];
        held[i] = hold;
        if (!hold) free_slope = std::max(free_slope, std::abs(slope[i]));
      }
      if (!factorised && !factorise(held)) return false;
      factorised = true;
      if (free_slope <= tolerance || iteration == kMaxIterations) break;
      U newton = slope;
      for (int i = 0; i < nu_; ++i) {
        if (held[i]) newton[i] = 0;
      }
      factor_.solveInPlace(newton);
      // Halving the projected step until the quadratic decreases by a part of what its slope
      // promises.
      const double now = k.dot(0.5 * (slope + g_));
      double length = 1.0;
      U trial, trial_slope;
      for (int halving = 0; halving < kMaxHalvings; ++halving, length *= 0.5) {
        trial = (k - length * newton).cwiseMax(lower).cwiseMin(upper);
        trial_slope = H_ * trial + g_;
        const double value = trial.dot(0.5 * (trial_slope + g_));
        if (value - now <= 0.1 * slope.dot(trial - k)) break;
      }
      k = trial;
      slope = trial_slope;
    }
    Eigen::Map<UX> K(stage.K.data(), nu_, nx_);
    K = -G_;
    for (int i = 0; i < nu_; ++i) {
      if (held[i]) K.row(i).setZero();
    }
    UX gain = K;
    factor_.solveInPlace(gain);
    K = gain;
    return true;
  }

  // Cholesky factor of H among the free inputs; rows and columns of held ones are the identity's.
  bool factorise(const bool* held) noexcept {
    UU free = H_;
    for (int i = 0; i < nu_; ++i) {
      if (!held[i]) continue;
      free.row(i).setZero();
      free.col(i).setZero();
      free(i, i) = 1.0;
    }
    factor_.compute(free);
    return factor_.info() == Eigen::Success;
  }

  int nx_, nu_;
  XX V_, next_;
  X v_;
  UU H_;
  UX G_;
  U g_;
  Eigen::LLT<UU> factor_;
};

}  // namespace

LqResult solve_lq(std::span<LqStage> stages, const Quadratic& terminal,
                  double regularisation) noexcept {
  const int nx = static_cast<int>(terminal.q.size());
  const int nu = stages.empty() ? 0 : static_cast<int>(stages[0].B.cols());
  if (nx == 9 && nu == 8) return Sweep<9, 8>(nx, nu).run(stages, terminal, regularisation);
  if (nx == 6 && nu == 6) return Sweep<6, 6>(nx, nu).run(stages, terminal, regularisation);
  return Sweep<Eigen::Dynamic, Eigen::Dynamic>(nx, nu).run(stages, terminal, regularisation);
}

}  // namespace wb
