// The backward sweep against a dense solution of the same LQ problem, and its box against brute
// force.
#include "mpc/riccati.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

namespace wb {
namespace {

constexpr double kTolerance = 1e-8;  // the dense KKT matrix is conditioned to about 1e6

struct Lq {
  std::vector<LqStage> stages;
  Quadratic terminal;
};

Lq random_lq(int nx, int nu, int count, double box, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto matrix = [&](int rows, int cols) {
    Eigen::MatrixXd m(rows, cols);
    for (int i = 0; i < m.size(); ++i) m.data()[i] = normal(random);
    return m;
  };
  const auto quadratic = [&] {
    const Eigen::MatrixXd q = matrix(nx, nx), r = matrix(nu, nu);
    Quadratic out;
    out.Q = q * q.transpose() / nx;
    out.R = r * r.transpose() / nu + 0.1 * Eigen::MatrixXd::Identity(nu, nu);
    out.q = matrix(nx, 1);
    out.r = matrix(nu, 1);
    return out;
  };
  Lq lq;
  for (int i = 0; i < count; ++i) {
    LqStage s;
    s.A = Eigen::MatrixXd::Identity(nx, nx) + 0.1 * matrix(nx, nx);
    s.B = 0.3 * matrix(nx, nu);
    s.cost = quadratic();
    s.lower.setConstant(nu, -box);
    s.upper.setConstant(nu, box);
    s.k.setZero(nu);
    lq.stages.push_back(s);
  }
  lq.terminal = quadratic();
  return lq;
}

class RiccatiSizes : public testing::TestWithParam<std::pair<int, int>> {};

// Unknowns dx_1..dx_N, du_0..du_N-1 and the multipliers of the dynamics, all at once.
TEST_P(RiccatiSizes, FeedbackLawSolvesTheDenseProblemFromAnyStart) {
  const auto [nx, nu] = GetParam();
  constexpr int kStages = 12;
  constexpr double kFar = 1e9, kRegularisation = 0.3;
  Lq lq = random_lq(nx, nu, kStages, kFar, 3);
  const LqResult result = solve_lq(lq.stages, lq.terminal, kRegularisation);
  ASSERT_TRUE(result.finite);

  const int xs = kStages * nx, us = kStages * nu, size = 2 * xs + us;
  Eigen::MatrixXd kkt = Eigen::MatrixXd::Zero(size, size);
  for (const double start : {0.0, 1.0, -2.5}) {
    const Eigen::VectorXd dx0 = Eigen::VectorXd::Constant(nx, start);
    Eigen::VectorXd rhs = Eigen::VectorXd::Zero(size);
    kkt.setZero();
    for (int i = 0; i < kStages; ++i) {
      const LqStage& s = lq.stages[i];
      const Quadratic& next = i + 1 < kStages ? lq.stages[i + 1].cost : lq.terminal;
      const int row_u = xs + i * nu, row_l = xs + us + i * nx;
      kkt.block(i * nx, i * nx, nx, nx) = next.Q;
      rhs.segment(i * nx, nx) = -next.q;
      kkt.block(row_u, row_u, nu, nu) =
          s.cost.R + kRegularisation * Eigen::MatrixXd::Identity(nu, nu);
      rhs.segment(row_u, nu) = -s.cost.r;
      kkt.block(row_l, i * nx, nx, nx) = Eigen::MatrixXd::Identity(nx, nx);
      kkt.block(row_l, row_u, nx, nu) = -s.B;
      if (i > 0) {
        kkt.block(row_l, (i - 1) * nx, nx, nx) = -s.A;
      } else {
        rhs.segment(row_l, nx) = s.A * dx0;
      }
    }
    kkt.topRightCorner(xs + us, xs) = kkt.bottomLeftCorner(xs, xs + us).transpose();
    const Eigen::VectorXd solution = kkt.fullPivLu().solve(rhs);
    ASSERT_LE((kkt * solution - rhs).norm(), kTolerance * (1.0 + rhs.norm()));

    Eigen::VectorXd dx = dx0;
    for (int i = 0; i < kStages; ++i) {
      const LqStage& s = lq.stages[i];
      const Eigen::VectorXd du = s.k + s.K * dx;
      EXPECT_LE((du - solution.segment(xs + i * nu, nu)).norm(), kTolerance * (1.0 + du.norm()));
      dx = s.A * dx + s.B * du;
    }
  }
}

TEST_P(RiccatiSizes, PredictedChangeIsThatOfTheQuadraticProblem) {
  const auto [nx, nu] = GetParam();
  Lq lq = random_lq(nx, nu, 5, 1e9, 4);
  const LqResult result = solve_lq(lq.stages, lq.terminal, 0.0);
  Eigen::VectorXd dx = Eigen::VectorXd::Zero(nx);
  double change = 0;
  for (const LqStage& s : lq.stages) {
    const Eigen::VectorXd du = s.k + s.K * dx;
    change += s.cost.q.dot(dx) + 0.5 * dx.dot(s.cost.Q * dx) + s.cost.r.dot(du) +
              0.5 * du.dot(s.cost.R * du);
    dx = s.A * dx + s.B * du;
  }
  change += lq.terminal.q.dot(dx) + 0.5 * dx.dot(lq.terminal.Q * dx);
  EXPECT_NEAR(result.linear + 0.5 * result.quadratic, change,
              kTolerance * (1.0 + std::abs(change)));
}

// The same with terms that couple x and u, and with equalities at every other stage.
TEST_P(RiccatiSizes, EqualitiesAndCouplingSolveTheDenseProblem) {
  const auto [nx, nu] = GetParam();
  constexpr int kStages = 6, kRows = 2;
  Lq lq = random_lq(nx, nu, kStages, 1e9, 5);
  std::mt19937 random(6);
  std::normal_distribution<double> normal;
  for (int i = 0; i < kStages; ++i) {
    LqStage& s = lq.stages[i];
    s.cost.couple();
    for (int k = 0; k < s.cost.P.size(); ++k) s.cost.P.data()[k] = 0.05 * normal(random);
    if (i % 2) continue;
    s.equality.set_zero(nx, nu);
    s.equality.rows = kRows;
    for (int r = 0; r < kRows; ++r) {
      s.equality.e[r] = normal(random);
      for (int c = 0; c < nx; ++c) s.equality.C(r, c) = normal(random);
      for (int c = 0; c < nu; ++c) s.equality.D(r, c) = normal(random);
    }
  }
  ASSERT_TRUE(solve_lq(lq.stages, lq.terminal, 0.0).finite);

  const int xs = kStages * nx, us = kStages * nu;
  const int rows = xs + kRows * kStages / 2;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(xs + us, xs + us), E(rows, xs + us);
  Eigen::VectorXd h(xs + us), e(rows);
  const Eigen::VectorXd dx0 = Eigen::VectorXd::LinSpaced(nx, -1, 1);
  E.setZero();
  e.setZero();
  int row = 0;
  for (int i = 0; i < kStages; ++i) {
    const LqStage& s = lq.stages[i];
    const Quadratic& next = i + 1 < kStages ? lq.stages[i + 1].cost : lq.terminal;
    const int u = xs + i * nu, before = (i - 1) * nx;
    H.block(i * nx, i * nx, nx, nx) = next.Q;
    h.segment(i * nx, nx) = next.q;
    H.block(u, u, nu, nu) = s.cost.R;
    h.segment(u, nu) = s.cost.r;
    if (i == 0) {
      h.segment(u, nu) += s.cost.P * dx0;
    } else {
      H.block(u, before, nu, nx) = s.cost.P;
      H.block(before, u, nx, nu) = s.cost.P.transpose();
    }
    E.block(row, i * nx, nx, nx).setIdentity();
    E.block(row, u, nx, nu) = -s.B;
    if (i == 0) {
      e.segment(row, nx) = s.A * dx0;
    } else {
      E.block(row, before, nx, nx) = -s.A;
    }
    row += nx;
    for (int r = 0; r < s.equality.rows; ++r, ++row) {
      E.block(row, u, 1, nu) = s.equality.D.row(r);
      e[row] = -s.equality.e[r];
      if (i == 0) {
        e[row] -= s.equality.C.row(r).dot(dx0);
      } else {
        E.block(row, before, 1, nx) = s.equality.C.row(r);
      }
    }
  }
  Eigen::MatrixXd kkt = Eigen::MatrixXd::Zero(xs + us + rows, xs + us + rows);
  kkt.topLeftCorner(xs + us, xs + us) = H;
  kkt.topRightCorner(xs + us, rows) = E.transpose();
  kkt.bottomLeftCorner(rows, xs + us) = E;
  Eigen::VectorXd rhs(xs + us + rows);
  rhs << -h, e;
  const Eigen::VectorXd solution = kkt.fullPivLu().solve(rhs);
  ASSERT_LE((kkt * solution - rhs).norm(), kTolerance * (1.0 + rhs.norm()));
  // The rows are regularised by a part in 1e9 of their own size.
  constexpr double kRowTolerance = 1e-6;
  Eigen::VectorXd dx = dx0;
  for (int i = 0; i < kStages; ++i) {
    const LqStage& s = lq.stages[i];
    const Eigen::VectorXd du = s.k + s.K * dx;
    EXPECT_LE((du - solution.segment(xs + i * nu, nu)).norm(), kRowTolerance * (1.0 + du.norm()));
    dx = s.A * dx + s.B * du;
  }
}

TEST(RiccatiBox, EqualitiesHoldBesideTheBoxWhereBothCan) {
  int bounded = 0;
  for (unsigned seed = 0; seed < 50; ++seed) {
    Lq lq = random_lq(6, 6, 1, 0.4, seed);
    LqStage& s = lq.stages[0];
    s.equality.set_zero(6, 6);
    s.equality.rows = 1;
    s.equality.D(0, 0) = 1;
    s.equality.D(0, 3) = -1;  // two inputs move alike
    ASSERT_TRUE(solve_lq(lq.stages, lq.terminal, 0.0).finite);
    for (int i = 0; i < 6; ++i) {
      EXPECT_GE(s.k[i], s.lower[i]);
      EXPECT_LE(s.k[i], s.upper[i]);
      bounded += s.k[i] == s.lower[i] || s.k[i] == s.upper[i];
    }
    EXPECT_NEAR(s.k[0], s.k[3], 1e-7);
  }
  EXPECT_GT(bounded, 20) << "the box is too wide to test anything";
}

INSTANTIATE_TEST_SUITE_P(CompiledInAndRunTime, RiccatiSizes,
                         testing::Values(std::pair{9, 8}, std::pair{6, 6}, std::pair{5, 3},
                                         std::pair{16, 15}),
                         [](const auto& info) {
                           return std::to_string(info.param.first) + "x" +
                                  std::to_string(info.param.second);
                         });

TEST(RiccatiBox, FeedForwardIsTheBestOfAllActiveSets) {
  constexpr int kInputs = 4;
  int bounded = 0;
  for (unsigned seed = 0; seed < 50; ++seed) {
    Lq lq = random_lq(6, kInputs, 1, 0.3, seed);
    ASSERT_TRUE(solve_lq(lq.stages, lq.terminal, 0.0).finite);
    const LqStage& s = lq.stages[0];
    const Eigen::MatrixXd H = s.cost.R + s.B.transpose() * lq.terminal.Q * s.B;
    const Eigen::VectorXd g = s.cost.r + s.B.transpose() * lq.terminal.q;
    const auto value = [&](const Eigen::VectorXd& u) { return 0.5 * u.dot(H * u) + g.dot(u); };
    double best = std::numeric_limits<double>::infinity();
    for (int set = 0; set < 81; ++set) {  // each input free, at its lower or at its upper bound
      Eigen::MatrixXd M = H;
      Eigen::VectorXd rhs = -g;
      for (int i = 0, rest = set; i < kInputs; ++i, rest /= 3) {
        if (rest % 3 == 0) continue;
        M.row(i) = Eigen::VectorXd::Unit(kInputs, i).transpose();
        rhs[i] = rest % 3 == 1 ? s.lower[i] : s.upper[i];
      }
      const Eigen::VectorXd u = M.fullPivLu().solve(rhs);
      if (((u.array() >= s.lower.array() - 1e-12) && (u.array() <= s.upper.array() + 1e-12))
              .all()) {
        best = std::min(best, value(u));
      }
    }
    EXPECT_NEAR(value(s.k), best, kTolerance);
    for (int i = 0; i < kInputs; ++i) {
      EXPECT_GE(s.k[i], s.lower[i]);
      EXPECT_LE(s.k[i], s.upper[i]);
      if (s.k[i] != s.lower[i] && s.k[i] != s.upper[i]) continue;
      ++bounded;
      EXPECT_EQ(s.K.row(i).norm(), 0.0);
    }
  }
  EXPECT_GT(bounded, 20) << "the box is too wide to test anything";
}

TEST(Riccati, NotANumberIsReported) {
  Lq lq = random_lq(9, 8, 3, 1.0, 1);
  lq.stages[1].cost.Q(0, 0) = std::nan("");
  EXPECT_FALSE(solve_lq(lq.stages, lq.terminal, 0.0).finite);
}

}  // namespace
}  // namespace wb
