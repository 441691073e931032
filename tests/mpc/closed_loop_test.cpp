// The MPC in closed loop with a plant that lags and policies that come late: where it ends, and
// what it keeps clear of.
#include "tests/mpc/closed_loop.hpp"

#include <gtest/gtest.h>

namespace wb::mpc_test {
namespace {

constexpr double kReached_m = 2e-3;  // the task's bound on a static goal

std::shared_ptr<const OptimalControlProblem> mobile() {
  static const auto problem = std::make_shared<const OptimalControlProblem>(mabi());
  return problem;
}

StateVector ready() { return state_at(*mabi(), {0, 0, 0}, mabi()->config().ready); }

// E as at the ready posture, moved by (x, y, z) in W; the arm prefers that posture.
Reference reach(double x, double y, double z) {
  Eigen::Isometry3d X = end_effector_pose(*mabi(), ready());
  X.translation() += Eigen::Vector3d(x, y, z);
  Reference reference = reach_for(Pose::from(X));
  reference.joint_count = mabi()->joints();
  std::copy_n(mabi()->config().ready.begin(), reference.joint_count, reference.posture.begin());
  return reference;
}

double distance_to(const ClosedLoop& loop, const Reference& reference) {
  return (loop.X_WE().translation() - reference.ee[0].keyframes[0].X_WE.position()).norm();
}

// Least distance of the unmasked, masked or all spheres to the field's obstacles.
enum class Which { kAll, kMasked, kUnmasked };
double clearance(const ClosedLoop& loop, const DistanceField& field, Which which = Which::kAll) {
  RobotModel::Data data;
  mabi()->forward_kinematics(loop.x().data(), data);
  double least = DistanceField::kNoMap;
  for (const Sphere& s : mabi()->spheres()) {
    if (which != Which::kAll && s.masked != (which == Which::kMasked)) continue;
    least = std::min(least, field.distance(data.X_WL[s.body] * s.centre) - s.radius);
  }
  return least;
}

TEST(ClosedLoop, StaticGoalIsReachedAndHeldWithoutRestlessness) {
  ClosedLoop loop(mobile(), ready());
  const Reference goal = reach(0.1, 0.15, 0.05);
  loop.run(goal, nullptr, 8.0);
  EXPECT_LE(distance_to(loop, goal), kReached_m);
  const double before = loop.variation();
  loop.run(goal, nullptr, 2.0);
  EXPECT_LE(distance_to(loop, goal), kReached_m);
  // All eight inputs together, in 2 s: less than a hundredth of the sum of their limits.
  EXPECT_LE(loop.variation() - before, 0.01 * mobile()->limits().velocity.sum());
}

TEST(ClosedLoop, GoalsOfTheReferenceProblemAreReachedInTurn) {
  RobotConfig config = mabi_config();
  config.end_effector = "WRIST_2";
  const auto model = std::make_shared<const RobotModel>(config);
  ClosedLoop loop(std::make_shared<const OptimalControlProblem>(model),
                  state_at(*model, {0, 0, 0}, {2.5, -1.0, 1.5, 0, 1.0, 0}));
  constexpr double kPass_m = 1e-2;  // the reference problem's own bound
  for (const Pose& pose : reference_goals()) {
    const Reference goal = reach_for(pose);
    loop.run(goal, nullptr, 8.0);
    EXPECT_LE(distance_to(loop, goal), kPass_m);
  }
}

TEST(ClosedLoop, GoalBehindTheRobotIsReached) {
  ClosedLoop loop(mobile(), ready());
  const Reference goal = reach(-1.2, 0.0, 0.0);
  loop.run(goal, nullptr, 12.0);
  EXPECT_LE(distance_to(loop, goal), 5e-3);
}

TEST(ClosedLoop, MovingGoalIsTrackedAsADrawerIsPulled) {
  ClosedLoop loop(mobile(), ready());
  Reference pull = reach(0, 0, 0);
  pull.ee[0].count = 2;
  pull.ee[0].keyframes[0].t_ns = from_seconds(1.0);
  pull.ee[0].keyframes[1] = {from_seconds(6.0), reach(-0.4, 0, 0).ee[0].keyframes[0].X_WE};
  double worst = 0;
  loop.run(pull, nullptr, 7.0, [&] {
    worst =
        std::max(worst, (loop.X_WE().translation() - sample(pull, loop.now()).ee[0].p_WE).norm());
  });
  EXPECT_LE(worst, 15e-3);  // the plant's lag alone is 50 ms x 0.08 m/s = 4 mm
}

TEST(ClosedLoop, BaseFollowsATimedRoute) {
  ClosedLoop loop(mobile(), state_at(*mabi(), {0, 0, 0}, mabi()->config().stowed));
  Reference route;
  route.base_count = 4;
  route.base[0] = {from_seconds(0.5), {0, 0, 0}};
  route.base[1] = {from_seconds(3.0), {0, 0, 0.9}};
  route.base[2] = {from_seconds(6.5), {1.24, 1.57, 0.9}};
  route.base[3] = {from_seconds(9.0), {1.24, 1.57, 0}};
  double worst = 0;
  loop.run(route, nullptr, 11.0, [&] {
    worst = std::max(worst, (loop.x().head<2>() - sample(route, loop.now()).base.head<2>()).norm());
  });
  EXPECT_LE(worst, 0.12);
  EXPECT_LE((loop.x().head<2>() - Eigen::Vector2d(1.24, 1.57)).norm(), 0.02);
  EXPECT_LE(std::abs(loop.x()[2]), 0.02);
}

// A box beside the hand; the goal is on its far side, and the straight way there, 0.7 m in 4 s,
// leads through it.
struct PastABox {
  Eigen::Vector3d hand = end_effector_pose(*mabi(), ready()).translation();
  DistanceField field = field_of(
      {{hand + Eigen::Vector3d(-0.10, 0.20, -0.6), hand + Eigen::Vector3d(0.25, 0.45, 0.1)}});
  Reference goal = reach(0, 0, 0);
  PastABox() {
    goal.ee[0].count = 2;
    goal.ee[0].keyframes[1] = {from_seconds(4.0), reach(0.0, 0.7, 0.0).ee[0].keyframes[0].X_WE};
  }
};

TEST(ClosedLoop, HandKeepsClearOfABoxOnItsWay) {
  const PastABox scene;
  ClosedLoop loop(mobile(), ready());
  double least = DistanceField::kNoMap;
  loop.run(scene.goal, &scene.field, 8.0,
           [&] { least = std::min(least, clearance(loop, scene.field)); });
  EXPECT_GE(least,
            -0.01);  // soft: a centimetre into spheres that overhang the robot by two to four
}

TEST(ClosedLoop, HandMeetsTheBoxWithoutTheEnvironmentTerm) {
  const PastABox scene;
  ClosedLoop loop(std::make_shared<const OptimalControlProblem>(
                      mabi(), std::vector<std::string>{"environment"}),
                  ready());
  double least = DistanceField::kNoMap;
  loop.run(scene.goal, &scene.field, 8.0,
           [&] { least = std::min(least, clearance(loop, scene.field)); });
  EXPECT_LE(least, -0.03);
}

// A cupboard in front of the hand with the goal in its front face, as a handle is.
TEST(ClosedLoop, MaskLetsTheMaskedSpheresInAndNoOthers) {
  const Eigen::Vector3d hand = end_effector_pose(*mabi(), ready()).translation();
  const DistanceField field =
      field_of({{hand + Eigen::Vector3d(0.15, -0.4, -0.6), hand + Eigen::Vector3d(0.8, 0.4, 0.3)}});
  Reference goal = reach(0.2, 0.0, 0.0);
  ClosedLoop barred(mobile(), ready());
  barred.run(goal, &field, 6.0);
  EXPECT_GE(distance_to(barred, goal), 0.05);

  goal.masks[0].active = true;
  goal.masks[0].X_WM.p = {hand.x() + 0.475, hand.y(), hand.z() - 0.15};
  goal.masks[0].half_extent = {0.325, 0.4, 0.45};
  ClosedLoop let_in(mobile(), ready());
  double least_unmasked = DistanceField::kNoMap;
  let_in.run(goal, &field, 6.0, [&] {
    least_unmasked = std::min(least_unmasked, clearance(let_in, field, Which::kUnmasked));
  });
  EXPECT_LE(distance_to(let_in, goal), 5e-3);
  EXPECT_LE(clearance(let_in, field, Which::kMasked), -0.03);
  EXPECT_GE(least_unmasked, -0.01);
}

TEST(ClosedLoop, SelfCollisionPairsKeepApart) {
  // The goal pulls the hand through the tower behind the shoulder.
  ClosedLoop loop(mobile(), ready());
  Reference goal = reach_for(pose(-0.35, 0.0, 0.7, 0, 0, 0, 1));
  goal.base_count = 1;  // and the base must not give way
  goal.base_scale = 10;
  goal.speed_scale = 0.5;
  const auto least = [&] {
    RobotModel::Data data;
    mabi()->forward_kinematics(loop.x().data(), data);
    double least = 1e9;
    for (const auto& [a, b] : mabi()->self_pairs()) {
      const Capsule &ca = mabi()->capsules()[a], &cb = mabi()->capsules()[b];
      // Brute force over both axes; 41 points a side are within 1 mm for capsules of 0.6 m.
      for (int i = 0; i <= 40; ++i) {
        for (int j = 0; j <= 40; ++j) {
          const Eigen::Vector3d pa =
              data.X_WL[ca.body] * Eigen::Vector3d(ca.p0 + i / 40.0 * (ca.p1 - ca.p0));
          const Eigen::Vector3d pb =
              data.X_WL[cb.body] * Eigen::Vector3d(cb.p0 + j / 40.0 * (cb.p1 - cb.p0));
          least = std::min(least, (pa - pb).norm() - ca.radius - cb.radius);
        }
      }
    }
    return least;
  };
  double worst = 1e9;
  int tick = 0;
  loop.run(goal, nullptr, 6.0, [&] {
    if (tick++ % 20 == 0) worst = std::min(worst, least());
  });
  EXPECT_GE(worst, 0.0);
  EXPECT_LE(worst, 0.06) << "nothing came near";
}

}  // namespace
}  // namespace wb::mpc_test
