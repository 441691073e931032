// Closed-loop scenarios of the MPC: how well each ends, how smooth it is, and what a solve costs,
// by phase, in equivalent milliseconds (DEFINITIONS.md, "Equivalent time"). Not a test: what the
// weights in mpc.yaml were tuned with.
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <numbers>
#include <string>

#include "bench/sweep.hpp"
#include "mpc/riccati.hpp"
#include "tests/mpc/closed_loop.hpp"

namespace wb::mpc_test {
namespace {

double cpu_ms() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

template <typename Work>
double time_ms(const Work& work) {
  const double start = cpu_ms();
  work();
  return cpu_ms() - start;
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

struct Stage {
  double duration_s;
  Reference reference;
};

void run(const char* name, const std::shared_ptr<const OptimalControlProblem>& problem,
         const StateVector& x0, const DistanceField* field, const std::vector<Stage>& stages) {
  ClosedLoop loop(problem, x0);
  std::printf("%s\n", name);
  for (const Stage& stage : stages) {
    double worst_p = 0, worst_base = 0, settled_s = -1, clearance = 1e9;
    int no_step = 0, solves = 0;
    double length = 0;
    TimeNs t_policy = -1;
    const TimeNs begin = loop.now();
    const double variation = loop.variation();
    loop.run(stage.reference, field, stage.duration_s, [&] {
      const ReferenceSample want = sample(stage.reference, loop.now());
      const double error =
          want.ee[0].active ? (loop.X_WE().translation() - want.ee[0].p_WE).norm() : 0;
      if (error > 0.01) settled_s = -1;
      if (error <= 0.01 && settled_s < 0) settled_s = to_seconds(loop.now() - begin);
      worst_p = std::max(worst_p, error);
      if (want.has_base)
        worst_base = std::max(worst_base, (loop.x().head<2>() - want.base.head<2>()).norm());
      if (field) {
        RobotModel::Data data;
        problem->model().forward_kinematics(loop.x().data(), data);
        for (const Sphere& s : problem->model().spheres()) {
          clearance = std::min(clearance, field->distance(data.X_WL[s.body] * s.centre) - s.radius);
        }
      }
      if (loop.policy().t_ns != t_policy) {
        t_policy = loop.policy().t_ns;
        ++solves;
        no_step += loop.status() != SolveStatus::kConverging;
        length += loop.report().step;
      }
    });
    const ReferenceSample want = sample(stage.reference, loop.now());
    const Eigen::Isometry3d X = loop.X_WE();
    std::printf("  %5.1f s:", stage.duration_s);
    if (stage.reference.joint_count > 0) {
      const Eigen::Map<const Eigen::VectorXd> q(stage.reference.posture.data(),
                                                stage.reference.joint_count);
      std::printf(" posture %.2f rad", (loop.x().tail(q.size()) - q).lpNorm<Eigen::Infinity>());
    }
    if (want.ee[0].active) {
      std::printf(" ee %6.2f mm %5.2f deg (worst %6.1f mm, within 10 mm from %5.2f s)",
                  1e3 * (X.translation() - want.ee[0].p_WE).norm(),
                  180 / std::numbers::pi *
                      Eigen::AngleAxisd(want.ee[0].R_WE.transpose() * X.linear()).angle(),
                  1e3 * worst_p, settled_s);
    }
    if (want.has_base) {
      std::printf(
          " base %6.1f mm %5.2f deg (worst %6.1f mm)",
          1e3 * (loop.x().head<2>() - want.base.head<2>()).norm(),
          180 / std::numbers::pi * std::remainder(loop.x()[2] - want.base[2], 2 * std::numbers::pi),
          1e3 * worst_base);
    }
    if (field) std::printf(" clearance %5.1f mm", 1e3 * clearance);
    std::printf(" | rate %.4f variation %6.2f cost %8.4f mean step %.2f refused %d/%d\n",
                loop.rate().norm(), loop.variation() - variation, loop.report().cost_after,
                length / solves, no_step, solves);
  }
}

// Time of a whole solve and of its parts along one closed-loop run, scaled by the interleaved
// sweep.
void run_timing(const std::shared_ptr<const OptimalControlProblem>& problem, const StateVector& x0,
                const DistanceField* field) {
  const bench::Sweep sweep;
  SlqSolver solver(problem);
  auto policy = std::make_unique<Policy>();
  SolveReport report;
  StateVector x = x0;
  std::vector<double> whole, linearise, riccati, rollout, swept;
  std::vector<LqStage> stages(problem->nodes() - 1);
  Quadratic terminal;
  Node node;
  double checksum = 0;
  const std::array<Pose, 4> goals = reference_goals();
  for (int call = 0; call < 1200; ++call) {
    Reference reference = reach_for(goals[(call / 90) % 4]);
    const TimeNs t0 = call * ClosedLoop::kPeriod;
    whole.push_back(time_ms([&] {
      if (solver.solve({t0, x.data(), &reference, field}, *policy, report) ==
          SolveStatus::kNotFinite) {
        std::printf("not finite at call %d\n", call);
      }
    }));
    const ReferenceSample wanted = sample(reference, t0);
    node.reference = &reference;
    node.field = field;
    node.sample = &wanted;
    const auto visit = [&](int i, Quadratic* quadratic) {
      node.terminal = i + 1 == problem->nodes();
      node.x = policy->x(i);
      if (!node.terminal) node.u = policy->u(i);
      checksum += problem->evaluate(node, quadratic, nullptr);
    };
    linearise.push_back(time_ms([&] {
      for (int i = 0; i + 1 < problem->nodes(); ++i) {
        visit(i, &stages[i].cost);
        problem->step_derivatives(policy->x(i).data(), policy->u(i).data(), problem->weight_s(i),
                                  stages[i].A, stages[i].B);
        stages[i].k.setZero(problem->nu());
        stages[i].lower = -problem->limits().velocity - policy->u(i);
        stages[i].upper = problem->limits().velocity - policy->u(i);
        stages[i].cost.q *= problem->weight_s(i);
        stages[i].cost.Q *= problem->weight_s(i);
        stages[i].cost.r *= problem->weight_s(i);
        stages[i].cost.R *= problem->weight_s(i);
      }
      visit(problem->nodes() - 1, &terminal);
    }));
    riccati.push_back(time_ms([&] { checksum += solve_lq(stages, terminal, 0.0).linear; }));
    rollout.push_back(time_ms([&] {
      for (int i = 0; i < problem->nodes(); ++i) visit(i, nullptr);
    }));
    swept.push_back(time_ms([&] { checksum += sweep.run(); }));
    StateVector next(x.size());
    problem->step(x.data(), policy->u(0).data(), to_seconds(ClosedLoop::kPeriod), next.data());
    x = next;
  }
  const double scale = bench::kSweepReferenceMs / quantile(swept, 0.5);
  std::printf(
      "timing, %d nodes, %zu spheres, %zu pairs, equivalent ms (median, p99); sweep %.3f ms, "
      "p99/median %.2f\n",
      problem->nodes(), problem->model().spheres().size(), problem->model().self_pairs().size(),
      quantile(swept, 0.5), quantile(swept, 0.99) / quantile(swept, 0.5));
  const auto line = [&](const char* what, const std::vector<double>& times) {
    std::printf("  %-12s %6.3f %6.3f\n", what, scale * quantile(times, 0.5),
                scale * quantile(times, 0.99));
  };
  line("solve", whole);
  line("linearise", linearise);
  line("riccati", riccati);
  line("one rollout", rollout);
  if (!std::isfinite(checksum)) std::printf("checksum is not finite\n");
}

Reference with_posture(Reference reference, const std::vector<double>& q) {
  reference.joint_count = static_cast<int>(q.size());
  std::copy(q.begin(), q.end(), reference.posture.begin());
  return reference;
}

// Turn in place, drive, turn back, each at a fraction of the limits, as the daemon's route planner
// does.
Reference route(TimeNs start, double x, double y) {
  Reference reference;
  const double heading = std::atan2(y, x), turn_s = std::abs(heading) / 0.5 + 0.5,
               drive_s = std::hypot(x, y) / 0.5 + 0.5;
  const auto at = [&](double t_s, double bx, double by, double yaw) {
    reference.base[reference.base_count++] = {start + from_seconds(t_s), {bx, by, yaw}};
  };
  at(0.5, 0, 0, 0);
  at(0.5 + turn_s, 0, 0, heading);
  at(0.5 + turn_s + drive_s, x, y, heading);
  at(0.5 + 2 * turn_s + drive_s, x, y, 0);
  reference.ee[0].position_scale = reference.ee[0].orientation_scale = 0;
  return reference;
}

}  // namespace
}  // namespace wb::mpc_test

int main(int argc, char** argv) {
  using namespace wb;
  using namespace wb::mpc_test;
  const RobotConfig config = mabi_config();
  const auto model = mabi();
  const auto problem = std::make_shared<const OptimalControlProblem>(model);
  const StateVector ready = state_at(*model, {0, 0, 0}, config.ready);
  const StateVector stowed = state_at(*model, {0, 0, 0}, config.stowed);
  const Eigen::Isometry3d X_ready = end_effector_pose(*model, ready);
  const auto shifted = [&](double x, double y, double z) {
    Eigen::Isometry3d X = X_ready;
    X.translation() += Eigen::Vector3d(x, y, z);
    return with_posture(reach_for(Pose::from(X)), config.ready);
  };
  const std::string only = argc > 1 ? argv[1] : "";
  const auto wanted = [&](const char* name) { return only.empty() || only == name; };

  if (wanted("hold")) run("hold at ready", problem, ready, nullptr, {{4, shifted(0, 0, 0)}});
  if (wanted("near")) {
    run("0.1 m, 0.3 m, back", problem, ready, nullptr,
        {{5, shifted(0.1, 0, 0)},
         {5, shifted(0.1, 0.3, 0)},
         {5, shifted(0, 0, 0.1)},
         {5, shifted(0, 0, 0)}});
  }
  if (wanted("far")) {
    run("1 m ahead, 1 m aside, 1 m behind", problem, ready, nullptr,
        {{8, shifted(1, 0, 0)}, {10, shifted(1, 1, 0)}, {10, shifted(0, 0, 0)}});
  }
  if (wanted("stow")) {
    run("from stowed to ready", problem, stowed, nullptr, {{8, shifted(0, 0, 0)}});
    Reference posture = with_posture(Reference{}, config.ready);
    posture.posture_scale = 300;
    run("from stowed to ready, posture alone, scale 300", problem, stowed, nullptr, {{5, posture}});
  }
  if (wanted("drawer")) {
    Reference pull = shifted(0, 0, 0);
    pull.ee[0].count = 2;
    pull.ee[0].keyframes[0].t_ns = from_seconds(1.0);
    pull.ee[0].keyframes[1] = {from_seconds(6.0), shifted(-0.45, 0, 0).ee[0].keyframes[0].X_WE};
    run("drawer: 0.45 m in 5 s", problem, ready, nullptr, {{8, pull}});
    Reference door = shifted(0, 0, 0);
    door.ee[0].count = 21;
    const Eigen::Vector3d hinge = X_ready.translation() + Eigen::Vector3d(0, 0.45, 0);
    for (int i = 0; i <= 20; ++i) {
      const Eigen::AngleAxisd turn(-1.4 * i / 20, Eigen::Vector3d::UnitZ());
      Eigen::Isometry3d X = X_ready;
      X.translation() = hinge + turn * (X_ready.translation() - hinge);
      X.linear() = turn * X_ready.linear();
      door.ee[0].keyframes[i] = {from_seconds(1.0 + 0.4 * i), Pose::from(X)};
    }
    run("door: 80 degrees at 0.45 m in 8 s", problem, ready, nullptr, {{11, door}});
  }
  if (wanted("route")) {
    const Reference there = with_posture(route(0, 1.5, 1.0), config.stowed);
    Reference arrived = shifted(1.5, 1.0, 0);
    arrived.base_count = 1;
    arrived.base[0] = there.base[3];
    run("route to (1.5, 1.0), then reach", problem, stowed, nullptr, {{11, there}, {6, arrived}});
    const Reference back = with_posture(route(0, -0.8, 0.1), config.stowed);
    run("route to (-0.8, 0.1)", problem, stowed, nullptr, {{18, back}});
  }
  if (wanted("box")) {
    const Eigen::Vector3d hand = X_ready.translation();
    const DistanceField field = field_of(
        {{hand + Eigen::Vector3d(-0.1, 0.2, -0.6), hand + Eigen::Vector3d(0.25, 0.45, 0.1)}});
    Reference timed = shifted(0, 0, 0);
    timed.ee[0].count = 2;
    timed.ee[0].keyframes[1] = {from_seconds(4), shifted(0, 0.7, 0).ee[0].keyframes[0].X_WE};
    run("past a box, 0.7 m in 4 s", problem, ready, &field, {{6, timed}});
    Reference there = shifted(0, 0.7, 0), back = shifted(0, 0, 0);
    run("past a box and back, at once", problem, ready, &field, {{6, there}, {6, back}});
    there.speed_scale = back.speed_scale = 0.4;
    run("past a box and back, at once, speed scale 0.4", problem, ready, &field,
        {{8, there}, {8, back}});
  }
  if (wanted("goals")) {
    RobotConfig wrist = config;
    wrist.end_effector = "WRIST_2";
    const auto wrist_model = std::make_shared<const RobotModel>(wrist);
    const auto wrist_problem = std::make_shared<const OptimalControlProblem>(wrist_model);
    std::vector<Stage> stages;
    for (const Pose& goal : reference_goals()) stages.push_back({8, reach_for(goal)});
    run("the reference problem's goals", wrist_problem,
        state_at(*wrist_model, {0, 0, 0}, {2.5, -1.0, 1.5, 0, 1.0, 0}), nullptr, stages);
  }
  if (wanted("timing")) {
    const DistanceField field = field_of({{{3, -6, 0}, {6, 6, 3}},
                                          {{-6, -6, 0}, {-3, 6, 3}},
                                          {{-6, 2.5, 0}, {6, 6, 3}},
                                          {{-6, -6, 0}, {6, -2.5, 3}},
                                          {{0.8, -1.6, 0}, {1.6, -0.8, 0.7}}});
    run_timing(problem, state_at(*model, {0, 0, 0}, {2.5, -1.0, 1.5, 0, 1.0, 0}), &field);
  }
  return 0;
}
