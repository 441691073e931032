#include "daemon/robot/robot_check.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <random>

#include "bench/mpc_parts/derivative_check.hpp"
#include "core/model/import/inverse_kinematics.hpp"
#include "core/model/import/posture_search.hpp"
#include "daemon/robot/simulated_move.hpp"
#include "mpc/slq_solver.hpp"

namespace wb {
namespace {

constexpr double kDerivativeTolerance = 1e-6;
constexpr double kReachedShare = 0.9;
constexpr double kReached_m = 0.02;  // that a converged plan may miss its goal by
constexpr double kNear_rad = 0.4;  // the ready region: so far from each joint of the ready posture

class Checker {
 public:
  Checker(const std::filesystem::path& folder, const CheckOptions& options)
      : options_(options),
        model_(std::make_shared<const RobotModel>(RobotConfig::load(folder))),
        problem_(std::make_shared<const OptimalControlProblem>(model_)),
        range_(arm_range(*model_)),
        random_(options.seed) {}

  CheckLine derivatives() {
    bench::Situations situations(problem_, options_.seed);
    double worst = 0;
    std::string which;
    for (const auto& term : problem_->terms()) {
      const auto check = bench::check_derivatives(*problem_, *term, situations, options_.samples);
      if (check.worst < worst) continue;
      worst = check.worst;
      which = term->name();
    }
    return {"derivatives", worst <= kDerivativeTolerance, worst, "",
            "largest error of the MPC's " + std::to_string(problem_->terms().size()) + " terms (" +
                which + ") against central differences; at most 1e-6"};
  }

  CheckLine limits() const {
    double load = 0;
    std::string which;
    for (const auto* q : {&model_->config().stowed, &model_->config().ready}) {
      JointVector tau;
      model_->gravity(q->data(), tau);
      for (int j = 0; j < model_->joints(); ++j) {
        const double share = std::abs(tau[j]) / model_->limits(j).torque;
        if (share < load) continue;
        load = share;
        which = model_->config().joints[static_cast<std::size_t>(j)].name;
      }
    }
    return {"limits", load < 1, load, "",
            "largest share of a torque limit that gravity takes stowed or ready (" + which +
                "); below 1"};
  }

  CheckLine reachability() {
    int reached = 0;
    for (int k = 0; k < options_.samples; ++k) {
      const IkResult r = solve_ik(*model_, range_, hand(near_ready()), model_->config().ready);
      reached += r.position_error_m < 1e-3 && r.angle_error_rad < 1e-2;
    }
    const double share = static_cast<double>(reached) / options_.samples;
    return {"reachability", share >= kReachedShare, share, "",
            "share of goals of the ready region that inverse kinematics reaches from ready; at "
            "least 0.9"};
  }

  CheckLine self_collision(const char* name, double distance) const {
    return {name, distance >= kPairDistance_m, distance, "m",
            "smallest distance of the self-collision pairs; at least 0.05"};
  }
  double stowed_distance() const {
    return pair_distance(*model_, arm_data(*model_, model_->config().stowed));
  }
  double ready_distance() const {
    return pair_distance(*model_, arm_data(*model_, model_->config().ready));
  }

  // A plan to a pose of the ready region, with the whole body, until nothing changes.
  CheckLine solve() {
    constexpr int kIterations = 100;
    SlqSolver solver(problem_);
    StateVector x0 = StateVector::Zero(model_->nx());
    const std::vector<double>& ready = model_->config().ready;
    std::copy(ready.begin(), ready.end(), x0.data() + model_->base_dof());
    const auto reference = std::make_unique<Reference>();
    const Eigen::Isometry3d goal = hand(near_ready());
    reference->ee[0].count = 1;
    reference->ee[0].keyframes[0].X_WE = Pose::from(goal);
    SolveInput input;
    input.x0 = x0.data();
    input.reference = reference.get();
    const auto policy = std::make_unique<Policy>();
    SolveReport report;
    const int taken = solver.converge(input, kIterations, 1e-3, *policy, report);
    RobotModel::Data data;
    model_->forward_kinematics(solver.states().back().data(), data);
    const double missed =
        (model_->X_WF(model_->end_effector(), data).translation() - goal.translation()).norm();
    return {"solve", missed < kReached_m && std::isfinite(report.cost_after), missed, "m",
            "that the plan's end misses a goal of the ready region by, after " +
                std::to_string(taken) + " iterations; below 0.02"};
  }

 private:
  std::vector<double> near_ready() {
    std::vector<double> q = model_->config().ready;
    std::uniform_real_distribution<double> u(-kNear_rad, kNear_rad);
    for (std::size_t j = 0; j < q.size(); ++j) {
      const double room = 0.05 * (range_.upper[j] - range_.lower[j]);
      q[j] = std::clamp(q[j] + u(random_), range_.lower[j] + room, range_.upper[j] - room);
    }
    return q;
  }
  Eigen::Isometry3d hand(const std::vector<double>& q) const {
    return model_->X_WF(model_->end_effector(), arm_data(*model_, q));
  }

  CheckOptions options_;
  std::shared_ptr<const RobotModel> model_;
  std::shared_ptr<const OptimalControlProblem> problem_;
  ArmRange range_;
  std::mt19937 random_;
};

}  // namespace

std::vector<CheckLine> check_robot(const std::filesystem::path& folder,
                                   const CheckOptions& options) {
  std::vector<CheckLine> lines;
  std::unique_ptr<Checker> checker;
  try {
    checker = std::make_unique<Checker>(folder, options);
    lines.push_back({"config", true, 1, "", "robot.yaml, robot.urdf and mpc.yaml load strictly"});
  } catch (const std::exception& error) {
    return {{"config", false, 0, "", error.what()}};
  }
  lines.push_back(checker->derivatives());
  lines.push_back(checker->limits());
  lines.push_back(checker->reachability());
  lines.push_back(checker->self_collision("stowed", checker->stowed_distance()));
  lines.push_back(checker->self_collision("ready", checker->ready_distance()));
  lines.push_back(checker->solve());
  lines.push_back(check_simulated_move(folder, options.seed));
  return lines;
}

}  // namespace wb
