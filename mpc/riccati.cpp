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

// k and K on e + C dx + D du = 0. Inputs that leave the box are held at its bound and the rest is
// solved again, until none leaves it; at most one round for each input. Rows that the free inputs
// cannot satisfy are satisfied in the least squares' sense.
bool solve_constrained(const InputMatrix& H, const InputStateMatrix& G, const InputVector& g,
                       LqStage& stage, LqResult& result) noexcept {
  using Rows =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxEqualities, kMaxEqualities>;
  using RowsU =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxInputs, kMaxEqualities>;
  using RowsX =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxEqualities, kMaxStates>;
  using RowsV = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxEqualities, 1>;
  const Equality& eq = stage.equality;
  const int m = eq.rows, nu = static_cast<int>(g.size());
  InputVector& k = stage.k;
  bool held[kMaxInputs] = {};
  k.setZero(nu);
  for (int round = 0; round <= nu && round < kMaxStageFactorisations; ++round) {
    InputMatrix free = H;
    InputVector at_bounds = InputVector::Zero(nu);
    for (int i = 0; i < nu; ++i) {
      if (!held[i]) continue;
      at_bounds[i] = k[i];
      free.row(i).setZero();
      free.col(i).setZero();
      free(i, i) = 1.0;
    }
    ++result.factorisations;
    const Eigen::LLT<InputMatrix> factor(free);
    if (factor.info() != Eigen::Success) return false;
    InputVector newton = -g;
    newton.noalias() -= H.lazyProduct(at_bounds);
    InputStateMatrix gain = -G;
    RowsU D_t = eq.D.topRows(m).transpose();
    for (int i = 0; i < nu; ++i) {
      if (!held[i]) continue;
      newton[i] = 0;
      gain.row(i).setZero();
      D_t.row(i).setZero();
    }
    factor.solveInPlace(newton);
    factor.solveInPlace(gain);
    RowsU Y = D_t;
    factor.solveInPlace(Y);
    Rows S = D_t.transpose().lazyProduct(Y);
    S.diagonal().array() += 1e-9 * (1e-12 + S.trace());
    const Eigen::LLT<Rows> schur(S);
    if (schur.info() != Eigen::Success) return false;
    RowsV residual = eq.e.head(m);
    residual.noalias() += D_t.transpose().lazyProduct(newton);
    residual.noalias() += eq.D.topRows(m).lazyProduct(at_bounds);
    schur.solveInPlace(residual);
    RowsX coupling = eq.C.topRows(m);
    coupling.noalias() += D_t.transpose().lazyProduct(gain);
    schur.solveInPlace(coupling);
    k = newton + at_bounds;
    k.noalias() -= Y.lazyProduct(residual);
    stage.K = gain;
    stage.K.noalias() -= Y.lazyProduct(coupling);
    bool left = false;
    for (int i = 0; i < nu; ++i) {
      if (!held[i] && !(k[i] >= stage.lower[i] && k[i] <= stage.upper[i])) {
        k[i] = k[i] < stage.lower[i] ? stage.lower[i] : stage.upper[i];
        held[i] = left = true;
      }
      if (held[i]) stage.K.row(i).setZero();
    }
    if (!left) break;
  }
  k = k.cwiseMax(stage.lower).cwiseMin(stage.upper);
  return k.allFinite();
}

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
      if (stage.cost.coupled) G_ += View<UX>(stage.cost.P.data(), nu_, nx_);
      g_ = View<U>(stage.cost.r.data(), nu_);
      g_.noalias() += B.transpose() * v_;
      stage.k.conservativeResize(nu_);
      stage.K.resize(nu_, nx_);
      const bool constrained = stage.equality.rows > 0;
      if (!(constrained ? solve_constrained(H_, G_, g_, stage, result)
                        : solve_box(stage, result))) {
        result.failed_stage = i;
        return result;
      }
      const Eigen::Map<U> k(stage.k.data(), nu_);
      const Eigen::Map<UX> K(stage.K.data(), nu_, nx_);
      result.linear += g_.dot(k);
      const U Hk = H_ * k;
      result.quadratic += k.dot(Hk);
      next_ = View<XX>(stage.cost.Q.data(), nx_, nx_);
      next_.noalias() += A.transpose() * VA;
      next_.noalias() += G_.transpose() * K;
      X v_next = A.transpose() * v_ + G_.transpose() * k;
      if (constrained) {
        const UX HK_G = H_ * K + G_;
        next_.noalias() += K.transpose() * HK_G;
        v_next.noalias() += K.transpose() * (Hk + g_);
      }  // else K is zero at the bounds and optimal elsewhere: K'(HK + G) = 0 and K'(Hk + g) = 0
      v_ = View<X>(stage.cost.q.data(), nx_) + v_next;
      V_ = 0.5 * (next_ + next_.transpose());
      stage.V.resize(nx_, nx_);
      stage.v.resize(nx_);
      Eigen::Map<XX>(stage.V.data(), nx_, nx_) = V_;
      Eigen::Map<X>(stage.v.data(), nx_) = v_;
    }
    result.finite =
        std::isfinite(result.linear) && std::isfinite(result.quadratic) && v_.allFinite();
    if (!result.finite) result.failed_stage = 0;
    return result;
  }

 private:
  // Projected Newton: k = argmin k'Hk / 2 + g'k within the box, and K for the inputs that are free
  // there.
  bool solve_box(LqStage& stage, LqResult& result) noexcept {
    constexpr int kMaxIterations = kMaxStageFactorisations - 1, kMaxHalvings = 8;
    Eigen::Map<U> k(stage.k.data(), nu_);
    const View<U> lower(stage.lower.data(), nu_), upper(stage.upper.data(), nu_);
    k = k.cwiseMax(lower).cwiseMin(upper);
    U slope = H_ * k + g_;
    const double tolerance = 1e-14 * (1.0 + g_.template lpNorm<Eigen::Infinity>());
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
      if (!factorised && !factorise(held, result)) return false;
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
  bool factorise(const bool* held, LqResult& result) noexcept {
    ++result.factorisations;
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
  if (nx == 7 && nu == 7) return Sweep<7, 7>(nx, nu).run(stages, terminal, regularisation);
  return Sweep<Eigen::Dynamic, Eigen::Dynamic>(nx, nu).run(stages, terminal, regularisation);
}

}  // namespace wb
