// The arm can bear the wrench that is to come: with Reference::ee[k].wrench_W on an end-effector
// and its own weight, every joint's static torque stays below its limit. Relaxed barrier on
// z = 1 -+ tau_i / tau_max_i - margin. The wrench is fixed in W. Source: Siciliano et al. 2009,
// Sec. 3.8 (statics).
#include "mpc/relaxed_barrier.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

constexpr double kGravity = 9.81;

// Static torque of one joint and its gradient.
struct StaticTorque {
  double value = 0;
  StateVector gradient;
};

class WrenchTerm final : public Term {
 public:
  WrenchTerm(RelaxedBarrier barrier, double margin, ModelPtr model)
      : Term("wrench", TermKind::kSoftInequality, TermScope::kStageAndTerminal),
        barrier_(barrier),
        margin_(margin),
        model_(std::move(model)) {
    ancestors_.resize(static_cast<std::size_t>(model_->bodies()), 0);
    for (int body = 1; body < model_->bodies(); ++body) {
      for (int b = body; b > 0; b = model_->parent(b)) ancestors_[body] |= 1u << b;
    }
  }

  double evaluate(Node& node, Quadratic* quadratic) const noexcept override {
    bool active = false;
    for (int k = 0; k < model_->end_effectors(); ++k)
      active = active || node.reference->ee[k].wrench_active;
    if (!active) return 0.0;
    RobotModel::Subtrees subtrees;
    model_->subtrees(node.kinematics, subtrees);
    std::array<StaticTorque, kMaxJoints> torques;
    for (int j = 0; j < model_->joints(); ++j) torques[j].gradient.setZero(model_->nx());
    for (int body = 1; body < model_->bodies(); ++body)
      add_static_torque(node, subtrees, body, quadratic != nullptr,
                        torques[model_->joint_of(body)]);
    double cost = 0;
    for (int j = 0; j < model_->joints(); ++j) {
      const StaticTorque& torque = torques[j];
      const double most = model_->limits(j).torque;
      for (const double sign : {1.0, -1.0}) {
        const double z = 1.0 - sign * torque.value / most - margin_;
        node.violation = std::max(node.violation, -z);
        const RelaxedBarrier::Value v = barrier_.at(z);
        cost += v.value;
        if (!quadratic || v.slope == 0.0) continue;
        const StateVector gradient = -sign / most * torque.gradient;
        quadratic->q += v.slope * gradient;
        for (int c = 0; c < gradient.size(); ++c)
          quadratic->Q.col(c) += v.curvature * gradient[c] * gradient;
      }
    }
    return cost;
  }

 private:
  bool carries(int body, int other) const { return ancestors_[other] & (1u << body); }

  // What body i asks of the joint that moves it.
  void add_static_torque(const Node& node, const RobotModel::Subtrees& subtrees, int i,
                         bool with_gradient, StaticTorque& out) const noexcept {
    const RobotModel::Data& data = node.kinematics;
    const Eigen::Vector3d axis = model_->ratio(i) * data.axis_W[i],
                          origin = data.X_WL[i].translation();
    const Eigen::Vector3d weight(0, 0, kGravity * subtrees.mass[i]);  // what the motor holds up
    const bool slides = model_->prismatic(i);
    Eigen::Vector3d load =
        slides ? weight : Eigen::Vector3d((subtrees.com_W[i] - origin).cross(weight));
    std::array<Eigen::Vector3d, kMaxEndEffectors> p, f;
    std::array<bool, kMaxEndEffectors> pushed{};
    for (int k = 0; k < model_->end_effectors(); ++k) {
      const EndEffectorReference& ee = node.reference->ee[k];
      const int frame = model_->end_effector(k);
      pushed[k] = ee.wrench_active && carries(i, model_->frame_body(frame));
      if (!pushed[k]) continue;
      p[k] = model_->X_WF(frame, data).translation();
      f[k] = Eigen::Map<const Eigen::Vector3d>(ee.wrench_W.data());
      const Eigen::Map<const Eigen::Vector3d> moment(ee.wrench_W.data() + 3);
      load -= slides ? f[k] : Eigen::Vector3d((p[k] - origin).cross(f[k]) + moment);
    }
    out.value += axis.dot(load);
    if (!with_gradient) return;

    // Of a rotation about `about` that carries joint i and all beyond it; forces stay as they are.
    const auto turned = [&](const Eigen::Vector3d& about) {
      double slope = about.cross(axis).dot(load);
      if (slides) return slope;
      slope += axis.dot(about.cross(subtrees.com_W[i] - origin).cross(weight));
      for (int k = 0; k < model_->end_effectors(); ++k) {
        if (pushed[k]) slope -= axis.dot(about.cross(p[k] - origin).cross(f[k]));
      }
      return slope;
    };
    const int base = model_->base_dof();
    if (base > 0) out.gradient[2] += turned(Eigen::Vector3d::UnitZ());
    for (int j = 1; j < model_->bodies(); ++j) {
      double& slope = out.gradient[base + model_->joint_of(j)];
      const Eigen::Vector3d axis_j = model_->ratio(j) * data.axis_W[j];
      if (carries(j, i)) {
        if (!model_->prismatic(j)) slope += turned(axis_j);
      } else if (carries(i, j) && !slides) {
        // Joint j moves a part of what joint i carries.
        const auto motion = [&](const Eigen::Vector3d& point) {
          return model_->prismatic(j)
                     ? data.axis_W[j]
                     : Eigen::Vector3d(data.axis_W[j].cross(point - data.X_WL[j].translation()));
        };
        slope = axis.dot(
            motion(subtrees.com_W[j]).cross(Eigen::Vector3d(0, 0, kGravity * subtrees.mass[j])));
        for (int k = 0; k < model_->end_effectors(); ++k) {
          if (pushed[k] && carries(j, model_->frame_body(model_->end_effector(k))))
            slope -= axis.dot(motion(p[k]).cross(f[k]));
        }
      }
    }
  }

  RelaxedBarrier barrier_;
  double margin_;
  ModelPtr model_;
  std::vector<unsigned> ancestors_;  // by body: a bit for each body on its way to the base
};

}  // namespace

std::unique_ptr<Term> make_wrench_term(const config::Section& section, const ModelPtr& model,
                                       WeightTable&) {
  RelaxedBarrier barrier;
  barrier.mu = section.number("mu", config::kPositive);
  barrier.reach = section.number("reach_fraction", {1e-6, 1.0});
  barrier.delta = section.number("delta_fraction", {1e-6, barrier.reach});
  const double margin = section.number("margin_fraction", config::kFraction);
  section.finish();
  return std::make_unique<WrenchTerm>(barrier, margin, model);
}

}  // namespace wb
