// The terms of the MPC's cost, each made from its own section of mpc.yaml. Setup world: throws
// config::ConfigError. OptimalControlProblem registers them; to add one, write its file here,
// declare it below and enter it there.
#pragma once
#include <memory>

#include "core/config/config.hpp"
#include "mpc/term.hpp"
#include "mpc/weight_table.hpp"

namespace wb {

using ModelPtr = std::shared_ptr<const RobotModel>;

std::unique_ptr<Term> make_input_term(const config::Section& section, const ModelPtr& model,
                                      WeightTable& weights);
std::unique_ptr<Term> make_end_effector_term(const config::Section& section, const ModelPtr& model,
                                             WeightTable& weights);
std::unique_ptr<Term> make_twist_term(const config::Section& section, const ModelPtr& model,
                                      WeightTable& weights);
std::unique_ptr<Term> make_wrench_term(const config::Section& section, const ModelPtr& model,
                                       WeightTable& weights);
std::unique_ptr<Term> make_velocity_constraint_term(const config::Section& section,
                                                    const ModelPtr& model, WeightTable& weights);
std::unique_ptr<Term> make_posture_term(const config::Section& section, const ModelPtr& model,
                                        WeightTable& weights);
std::unique_ptr<Term> make_base_route_term(const config::Section& section, const ModelPtr& model,
                                           WeightTable& weights);
std::unique_ptr<Term> make_joint_limits_term(const config::Section& section, const ModelPtr& model,
                                             WeightTable& weights);
std::unique_ptr<Term> make_velocity_limits_term(const config::Section& section,
                                                const ModelPtr& model, WeightTable& weights);
std::unique_ptr<Term> make_self_collision_term(const config::Section& section,
                                               const ModelPtr& model, WeightTable& weights);
std::unique_ptr<Term> make_environment_term(const config::Section& section, const ModelPtr& model,
                                            WeightTable& weights);
std::unique_ptr<Term> make_stability_term(const config::Section& section, const ModelPtr& model,
                                          WeightTable& weights);

}  // namespace wb
