// Hard: row . V_WE = rate for every row of Reference::ee[k].constraints (a hand that must stay on
// the path of what it holds). A state-input equality; the solver projects it out of every step.
#include "mpc/terms/body_twist.hpp"
#include "mpc/terms/terms.hpp"

namespace wb {
namespace {

class VelocityConstraintTerm final : public Term {
 public:
  explicit VelocityConstraintTerm(ModelPtr model)
      : Term("velocity_constraint", TermKind::kEquality, TermScope::kStage),
        model_(std::move(model)) {}

  void constrain(Node& node, Equality& equality, bool derivatives) const noexcept override {
    for (int k = 0; k < model_->end_effectors(); ++k) {
      const EndEffectorReference& ee = node.reference->ee[k];
      const int count = std::min(ee.constraint_count, kMaxVelocityConstraints);
      if (count <= 0) continue;
      BodyTwist twist;
      body_twist(*model_, model_->end_effector(k), node.kinematics, node.x, node.u, derivatives,
                 twist);
      for (int c = 0; c < count && equality.rows < kMaxEqualities; ++c) {
        const Eigen::Map<const Eigen::Matrix<double, 6, 1>> row(ee.constraints[c].row.data());
        equality.e[equality.rows] = row.dot(twist.V) - ee.constraints[c].rate;
        if (derivatives) {
          for (int i = 0; i < model_->nx(); ++i)
            equality.C(equality.rows, i) = row.dot(twist.V_x.col(i));
          for (int i = 0; i < model_->nu(); ++i)
            equality.D(equality.rows, i) = row.dot(twist.V_u.col(i));
        }
        ++equality.rows;
      }
    }
  }

 private:
  ModelPtr model_;
};

}  // namespace

std::unique_ptr<Term> make_velocity_constraint_term(const config::Section& section,
                                                    const ModelPtr& model, WeightTable&) {
  section.finish();
  return std::make_unique<VelocityConstraintTerm>(model);
}

}  // namespace wb
