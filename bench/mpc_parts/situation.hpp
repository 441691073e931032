// Random situations for the MPC's checks: a node with something to say for every term, and a whole
// problem that can be solved. Seeded; setup world. Any robot.
#pragma once
#include <cmath>
#include <filesystem>
#include <memory>
#include <random>

#include "mpc/slq_solver.hpp"

namespace wb::bench {

// Every robot of config/robots, by name.
inline std::vector<std::string> robot_names() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(WB_SOURCE_DIR "/config/robots")) {
    if (entry.is_directory()) names.push_back(entry.path().filename());
  }
  std::sort(names.begin(), names.end());
  return names;
}

inline std::shared_ptr<const RobotModel> load_robot(const std::string& name) {
  return std::make_shared<const RobotModel>(
      RobotConfig::load(std::filesystem::path(WB_SOURCE_DIR "/config/robots") / name));
}

// A floor and a few boxes about the origin, 0.1 m.
inline DistanceField cluttered_field() {
  DistanceField field({60, 60, 30}, 0.1);
  field.seq = 1;
  field.origin_W = {-3.0, -3.0, -0.5};
  const Eigen::Vector3d boxes[3][2] = {{{0.3, -0.6, 0.0}, {0.9, 0.1, 0.8}},
                                       {{-1, 0.6, 0}, {1, 1, 2}},
                                       {{-0.9, -0.8, 0.2}, {-0.4, -0.3, 1.2}}};
  for (int k = 0; k < 30; ++k) {
    for (int j = 0; j < 60; ++j) {
      for (int i = 0; i < 60; ++i) {
        const Eigen::Vector3d p = field.origin_W + 0.1 * Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5);
        double nearest = DistanceField::kNoMap;
        for (const auto& box : boxes) {
          const Eigen::Vector3d d = (box[0] - p).cwiseMax(p - box[1]);
          nearest = std::min(nearest, d.maxCoeff() > 0 ? d.cwiseMax(0.0).norm() : d.maxCoeff());
        }
        field.at(i, j, k) = static_cast<float>(nearest);
      }
    }
  }
  return field;
}

class Situations {
 public:
  Situations(std::shared_ptr<const OptimalControlProblem> problem, unsigned seed)
      : problem_(std::move(problem)),
        field_(cluttered_field()),
        weights_(problem_->weights().configured()),
        random_(seed) {}

  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  // Joints anywhere within their limits and `beyond` of their range outside.
  StateVector state(double beyond) {
    const RobotModel& model = problem_->model();
    StateVector x(model.nx());
    if (model.base_dof() > 0) x.head<3>() << uniform(-0.4, 0.4), uniform(-0.4, 0.4), uniform(-3, 3);
    for (int j = 0; j < model.joints(); ++j) {
      // A joint without limits turns twice about either way.
      const double low = std::max(model.limits(j).lower, -2 * M_PI);
      const double high = std::min(model.limits(j).upper, 2 * M_PI);
      x[model.base_dof() + j] = low + uniform(-beyond, 1 + beyond) * (high - low);
    }
    return x;
  }

  // Sets `node` to a random node at which every term has its say; it points into this object.
  void randomise(Node& node) {
    const RobotModel& model = problem_->model();
    Reference& r = reference_;
    r = {};
    r.joint_count = model.joints();
    r.base_count = 1;
    r.speed_scale = uniform(0.2, 1.0);
    r.base_scale = uniform(0, 2);
    r.masks[0].active = uniform(0, 1) < 0.5;
    r.masks[0].X_WM = Pose{{0.6, -0.25, 0.4}, {0, 0, 0, 1}};
    r.masks[0].half_extent = {0.3, 0.35, 0.4};
    for (double& q : r.posture) q = uniform(-1, 1);
    for (int k = 0; k < model.end_effectors(); ++k) {
      EndEffectorReference& ee = r.ee[k];
      ee.count = 1;
      ee.position_scale = uniform(0, 2);
      ee.orientation_scale = uniform(0, 2);
      const Eigen::Quaterniond q(uniform(-1, 1), uniform(-1, 1), uniform(-1, 1), uniform(-1, 1));
      ee.keyframes[0].X_WE =
          Pose::from({uniform(-1, 1), uniform(-1, 1), uniform(0, 1)}, q.normalized());
      ee.twist_active = ee.wrench_active = true;
      for (double& v : ee.twist_W) v = uniform(-0.3, 0.3);
      for (int i = 0; i < 6; ++i) ee.wrench_W[i] = uniform(-1, 1) * (i < 3 ? 60 : 10);
      ee.constraint_count = 2;
      for (int c = 0; c < 2; ++c) {
        for (double& v : ee.constraints[c].row) v = uniform(-1, 1);
        ee.constraints[c].rate = uniform(-0.1, 0.1);
      }
    }
    r.base[0].base = {uniform(-1, 1), uniform(-1, 1), uniform(-6, 6)};
    sample_ = sample(r, 0);
    node.reference = &r;
    node.sample = &sample_;
    node.field = &field_;
    node.weights = weights_.values.data();
    node.x = state(0.02);
    node.u.resize(model.nu());
    for (int i = 0; i < model.nu(); ++i)
      node.u[i] = uniform(-1.1, 1.1) * r.speed_scale * problem_->limits().velocity[i];
  }

  // No soft inequality is violated, nor as much as costs anything.
  bool free(const StateVector& x) {
    const Reference nothing;
    const ReferenceSample sample;
    Node node;
    node.reference = &nothing;
    node.sample = &sample;
    node.weights = weights_.values.data();
    node.terminal = true;
    node.x = x;
    return problem_->evaluate(node, nullptr, nullptr) == 0.0;
  }
  StateVector free_state() {
    for (;;) {
      const StateVector x = state(-0.1);
      if (free(x)) return x;
    }
  }

  // A goal that the arm reaches from the base's present place, within a joint's move of `reach` rad
  // (or m), in a posture that is free.
  Reference reachable_goal(const StateVector& x0, double reach) {
    const RobotModel& model = problem_->model();
    StateVector there;
    do {
      there = x0;
      for (int j = 0; j < model.joints(); ++j)
        there[model.base_dof() + j] += uniform(-reach, reach);
    } while (!free(there));
    RobotModel::Data data;
    model.forward_kinematics(there.data(), data);
    Reference goal;
    goal.ee[0].count = 1;
    goal.ee[0].keyframes[0].X_WE = Pose::from(model.X_WF(model.end_effector(), data));
    return goal;
  }

  const DistanceField& field() const { return field_; }
  const Weights& weights() const { return weights_; }

 private:
  std::shared_ptr<const OptimalControlProblem> problem_;
  DistanceField field_;
  Weights weights_;
  std::mt19937 random_;
  Reference reference_;
  ReferenceSample sample_;
};

}  // namespace wb::bench
