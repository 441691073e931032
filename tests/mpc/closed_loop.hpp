// MPC in closed loop with a kinematic plant: 400 Hz, acceleration limits as the gate's, rates that
// follow their commands with a first-order lag of 50 ms, and policies that arrive one MPC period
// (33 ms) after the state they were solved from.
#pragma once
#include <functional>

#include "tests/mpc/robot.hpp"

namespace wb::mpc_test {

class ClosedLoop {
 public:
  static constexpr TimeNs kTick = kNanosPerSecond / 400;
  static constexpr TimeNs kPeriod = kNanosPerSecond / 30;
  static constexpr double kLag_s = 0.05;

  ClosedLoop(std::shared_ptr<const OptimalControlProblem> problem, StateVector x0)
      : problem_(std::move(problem)),
        solver_(problem_),
        x_(std::move(x0)),
        policy_(std::make_unique<Policy>()),
        solved_(std::make_unique<Policy>()) {
    request_.setZero(problem_->nu());
    command_.setZero(problem_->nu());
    rate_.setZero(problem_->nu());
  }

  // Advances by `duration_s`; `watch` is called after every tick.
  void run(const Reference& reference, const DistanceField* field, double duration_s,
           const std::function<void()>& watch = {}) {
    const double dt = to_seconds(kTick);
    for (const TimeNs end = t_ + from_seconds(duration_s); t_ < end; t_ += kTick) {
      if (t_ >= due_) {
        std::swap(policy_, solved_);
        due_ = t_ + kPeriod;
        status_ = solver_.solve({t_, x_.data(), &reference, field}, *solved_, report_);
      }
      InputVector u(problem_->nu());
      StateVector x_ref(problem_->nx());
      if (policy_->nodes == 0 || !policy_->evaluate(t_, x_.data(), u.data(), x_ref.data()))
        u.setZero();
      const InputLimits& limits = problem_->limits();
      for (int r = 0; r < u.size(); ++r) {
        u[r] = std::clamp(u[r], -limits.velocity[r], limits.velocity[r]);
        const double change = limits.acceleration[r] * dt;
        variation_ += std::abs(u[r] - request_[r]);
        request_[r] = u[r];
        command_[r] = std::clamp(u[r], command_[r] - change, command_[r] + change);
        rate_[r] += (command_[r] - rate_[r]) * dt / kLag_s;
      }
      StateVector next(x_.size());
      problem_->step(x_.data(), rate_.data(), dt, next.data());
      x_ = next;
      if (watch) watch();
    }
  }

  TimeNs now() const { return t_; }
  const StateVector& x() const { return x_; }
  const InputVector& request() const { return request_; }
  const InputVector& rate() const { return rate_; }
  const Policy& policy() const { return *solved_; }
  const SolveReport& report() const { return report_; }
  SolveStatus status() const { return status_; }
  double variation() const { return variation_; }  // total variation of the requested inputs
  Eigen::Isometry3d X_WE() const { return end_effector_pose(problem_->model(), x_); }

 private:
  std::shared_ptr<const OptimalControlProblem> problem_;
  SlqSolver solver_;
  StateVector x_;
  InputVector request_, command_, rate_;
  std::unique_ptr<Policy> policy_, solved_;  // in force; on its way
  SolveReport report_;
  SolveStatus status_ = SolveStatus::kNoStep;
  TimeNs t_ = 0, due_ = 0;
  double variation_ = 0;
};

}  // namespace wb::mpc_test
