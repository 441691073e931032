#include "core/model/import/room_files.hpp"

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <sstream>

namespace wb {
namespace {

std::string number(double value, int digits = 4) {
  std::ostringstream out;
  out << std::fixed << std::setprecision(digits) << value;
  std::string s = out.str();
  s.erase(s.find_last_not_of('0') + 1);
  if (s.back() == '.') s.pop_back();
  return s == "-0" ? "0" : s;
}

// Two digits that count: guesses are no more exact.
double rounded(double value) {
  if (value <= 0) return 0;
  const double unit = std::pow(10, std::floor(std::log10(value)) - 1);
  return std::round(value / unit) * unit;
}

template <typename Values, typename Text>
std::string list(const Values& values, Text text) {
  std::string out = "[";
  for (const auto& v : values) out += (out.size() > 1 ? ", " : "") + text(v);
  return out + "]";
}
std::string names(const std::vector<std::string>& values) {
  return list(values, [](const std::string& s) { return s; });
}
std::string numbers(const std::vector<double>& values) {
  return list(values, [](double v) { return number(v); });
}
std::string vector3(const Eigen::Vector3d& v) { return numbers({v.x(), v.y(), v.z()}); }

// A value for each joint by a rule.
template <typename Rule>
std::vector<double> each(const RoomInputs& in, Rule rule) {
  std::vector<double> out;
  for (std::size_t j = 0; j < in.limits.size(); ++j) out.push_back(rounded(rule(j)));
  return out;
}
std::string by_joint(const RoomInputs& in, const std::vector<double>& values) {
  std::string out = "{";
  for (std::size_t j = 0; j < values.size(); ++j)
    out += (j ? ", " : "") + in.robot.joints[j].name + ": " + number(values[j]);
  return out + "}";
}

bool drives(const RoomInputs& in) { return in.structure.base != ImportedBase::kFixed; }

std::string header(const RoomInputs& in, const std::string& what) {
  return "# " + what + " of " + in.robot.name + ", written by `wbctl robot import` from " +
         in.source + ".\n";
}

// The camera that measures handles: one that says so, else the first.
std::string measuring_camera(const RobotStructure& s) {
  for (const char* word : {"shoulder", "head", "hand", "wrist"}) {
    for (const std::string& camera : s.cameras) {
      if (contains_any(camera, {word})) return camera;
    }
  }
  return s.cameras.front();
}

void write_base(std::ostream& out, const RoomInputs& in) {
  const RobotStructure& s = in.structure;
  out << "base:\n  kind: " << to_string(s.base) << "\n  link: " << in.robot.base.link << "\n";
  if (drives(in)) {
    out << "  wheels: " << names(s.wheels) << "\n  wheel_radius_m: " << number(s.wheel_radius_m)
        << "\n  track_m: " << number(s.track_m) << "\n";
    if (s.base == ImportedBase::kOmnidirectional)
      out << "  wheelbase_m: " << number(s.wheelbase_m) << "\n";
    out << "  # Guessed: what the wheels' speed limit yields, at most 1 m/s and 1 rad/s; full "
           "speed in "
           "one second, full turn in half.\n"
        << "  velocity_max_mps: " << number(in.velocity_max_mps)
        << "\n  yaw_rate_max_radps: " << number(in.yaw_rate_max_radps)
        << "\n  acceleration_max_mps2: " << number(in.velocity_max_mps)
        << "\n  yaw_acceleration_max_radps2: " << number(2 * in.yaw_rate_max_radps) << "\n";
  }
  out << "  bounding_radius_m: " << number(in.robot.base.bounding_radius_m)
      << "   # of the spheres in the stowed posture\n";
}

void write_shapes(std::ostream& out, const RoomInputs& in) {
  out << "# " << in.shapes_comment << "\ncollision_spheres:";
  if (in.robot.spheres.empty()) out << " []";
  out << "\n";
  for (const SphereConfig& s : in.robot.spheres) {
    out << "  - {link: " << s.link << ", centre_m: " << vector3(s.centre)
        << ", radius_m: " << number(s.radius) << ", masked: " << (s.masked ? "true" : "false")
        << "}\n";
  }
  out << "collision_capsules:" << (in.robot.capsules.empty() ? " []" : "") << "\n";
  for (const CapsuleConfig& c : in.robot.capsules) {
    out << "  - {name: " << c.name << ", link: " << c.link << ", p0_m: " << vector3(c.p0)
        << ", p1_m: " << vector3(c.p1) << ", radius_m: " << number(c.radius) << "}\n";
  }
  out << "# " << in.pairs_comment
      << "\nself_collision_pairs:" << (in.robot.self_pairs.empty() ? " []" : "") << "\n";
  for (const auto& [a, b] : in.robot.self_pairs) out << "  - [" << a << ", " << b << "]\n";
  out << "contact_excluded:   # links whose mutual contacts the plant leaves out"
      << (in.excluded.empty() ? "\n  []" : "") << "\n";
  for (const ExcludedContact& e : in.excluded)
    out << "  - [" << e.first << ", " << e.second << "]   # " << e.reason << "\n";
}

}  // namespace

std::string robot_yaml(const RoomInputs& in) {
  const RobotStructure& s = in.structure;
  std::ostringstream out;
  out << header(in, "What everyone may know") << "# Guessed, and worth a look:\n";
  for (const std::string& note : s.notes) out << "#   " << note << "\n";
  out << "name: " << in.robot.name << "\nurdf: robot.urdf\n";
  write_base(out, in);
  out << "# Accelerations are guessed: full speed in 0.3 s, if half of the torque that gravity "
         "leaves "
         "moves the joint's largest inertia so; at least full speed in 1 s.\n"
      << "joints:   # in the order of q\n";
  for (const JointConfig& j : in.robot.joints) {
    out << "  - {name: " << j.name << ", acceleration_max_radps2: " << number(j.acceleration_max)
        << "}\n";
  }
  out << "fingers: " << names(s.fingers)
      << "\ngripper_opening_max_m: " << number(s.gripper_opening_m)
      << "\nend_effector: " << s.end_effector << "\nshoulder_camera: " << measuring_camera(s)
      << "\nstowed_rad: " << numbers(in.robot.stowed) << "   # " << in.stowed_comment
      << "\nready_rad: " << numbers(in.robot.ready) << "   # " << in.ready_comment
      << "\n# Guessed: 160 x 120, 87 degrees wide.\ncameras:\n";
  for (const std::string& camera : s.cameras) {
    out << "  - {name: " << camera
        << ", width: 160, height: 120, fx: 84.3, fy: 84.3, cx: 80, cy: 60, range_min_m: 0.1, "
           "range_max_m: 8.0, rate_hz: 15}\n";
  }
  write_shapes(out, in);
  return out.str();
}

std::string mpc_yaml(const RoomInputs& in) {
  std::ostringstream out;
  out << header(in, "MPC")
      << "# Mabi-Mobile's weights; those of the joints by the rule beside them. Tune with `wbctl "
         "robot check`.\n"
      << "grid: {fine_step_s: 0.04, fine_until_s: 1.0, coarse_step_s: 0.1, horizon_s: 4.0}\n"
      << "terminal_weight_s: 1.0\n"
      << "solver:\n  line_search_steps: 3\n  line_search_ratio: 0.3\n  equality_penalty: 1000.0\n"
      << "  acceleration_fraction: 0.9\n"
      << "terms:\n  input:\n";
  if (drives(in)) out << "    base_velocity_s2pm2: 3.0\n    base_yaw_rate_s2prad2: 2.0\n";
  // A sliding joint weighs as a turning one that moves the hand as fast.
  const std::vector<double> effort = each(in, [&](std::size_t j) {
    const double arm = in.prismatic[j] ? in.reach_m : 1.0;
    return std::clamp(1.1 / std::sqrt(in.limits[j].velocity / arm), 0.3, 1.5) / (arm * arm);
  });
  out << "    # 1.1 / sqrt(velocity limit), 0.3 to 1.5: slow joints move less readily; sliding "
         "ones "
         "as if they turned at the arm's reach\n"
      << "    joint_velocity_s2prad2: " << numbers(effort) << "\n"
      << "  end_effector: {position_pm2: 80.0, orientation_prad2: 16.0}\n"
      << "  twist: {linear_s2pm2: 40.0, angular_s2prad2: 8.0}\n"
      << "  wrench: {mu: 0.05, delta_fraction: 0.02, reach_fraction: 0.3, margin_fraction: 0.05}\n"
      << "  velocity_constraint: {}\n"
      << "  posture: {joint_position_prad2: "
      << numbers(each(in, [&](auto j) { return in.prismatic[j] ? 0.5 : 0.02; }))
      << "}   # 20 cm of slide as a radian\n"
      << "  base_route: " << (drives(in) ? "{position_pm2: 40.0, yaw_prad2: 20.0}" : "{}") << "\n"
      << "  joint_limits: {mu: 0.05, delta_rad: 0.01, reach_rad: " << number(in.limit_reach)
      << ", margin_rad: " << number(kLimitDistance) << "}\n"
      << "  velocity_limits: {mu: 0.01, delta_fraction: 0.1, reach_fraction: 0.5}\n"
      << "  self_collision: {mu: 0.04, delta_m: 0.004, reach_m: " << number(kPairReach_m)
      << ", minimum_distance_m: " << number(kPairDistance_m) << "}\n"
      << "  environment: {mu_pm2: 2000.0, delta_m: 0.03, margin_m: 0.0}\n"
      << "  # The largest circle between the wheels and castors on the floor.\n"
      << "  stability: {" << (in.support_radius_m > 0 ? "" : "enabled: false, ")
      << "mu: 0.02, delta_m: 0.005, reach_m: 0.05, support_centre_m: ["
      << number(in.support_centre_m.x()) << ", " << number(in.support_centre_m.y())
      << "], support_radius_m: " << number(std::max(0.01, in.support_radius_m))
      << ", margin_m: 0.015}\n";
  return out.str();
}

std::string route_yaml(const RoomInputs& in) {
  std::ostringstream out;
  out << header(in, "Base route") << "margin_m: 0.03\n"
      << "comfort_m: " << number(rounded(1.5 * in.robot.base.bounding_radius_m))
      << "          # one and a half bounding radii\ncomfort_weight: 4.0\nheight_low_m: 0.05\n"
      << "height_high_m: " << number(std::ceil(10 * in.height_m) / 10)
      << "      # top of the stowed robot\nlookahead_m: 0.35\n"
      << (in.structure.base == ImportedBase::kOmnidirectional ? "" : "reverse_m: 0.5\n")
      << "speed_factor: 0.9\n";
  return out.str();
}

std::string mapping_yaml(const RoomInputs& in) {
  // The window holds the robot at its reach, and a metre beyond.
  const double half = std::max(4.0, in.robot.base.bounding_radius_m + in.reach_m + 1.0);
  const double top = std::max(3.0, in.height_m + in.reach_m);
  const auto voxels = [](double length) { return number(std::ceil(length / 0.1)); };
  std::ostringstream out;
  out << header(in, "The map around the base")
      << "# At least 8 x 8 x 3 m; more for a longer arm. Evidence: see Mabi-Mobile's file.\n"
      << "size_voxels: [" << voxels(2 * half) << ", " << voxels(2 * half) << ", " << voxels(top)
      << "]\nresolution_m: 0.1\nbottom_m: -0.2\nrecentre_m: 0.5\nfloor_height_m: 0.05\n"
      << "solid_behind_m: 0.3\ntruncation_m: 2.0\nno_return_carve_m: 0.0\nrobot_padding_m: 0.04\n"
      << "log_odds_hit: 0.85\nlog_odds_miss: 0.3\nlog_odds_min: -0.6\nlog_odds_max: 2.0\n"
      << "log_odds_occupied: 1.0\n";
  return out.str();
}

namespace {
// A servo of 17 rad/s on all that its drive moves, stiffer where friction would hold the joint
// beside its goal.
constexpr double kServo_radps = 17, kDampingRatio = 0.8;
constexpr double kStuck = 0.008;  // rad or m, by friction
double stiffness(const RoomInputs& in, std::size_t j) {
  return std::max(kServo_radps * kServo_radps * in.inertia[j], in.friction[j] / kStuck);
}
double damping(const RoomInputs& in, std::size_t j) {
  return 2 * kDampingRatio * std::sqrt(stiffness(in, j) * in.inertia[j]);
}
double rotor(const RoomInputs& in, std::size_t j) { return in.rotor[j]; }
}  // namespace

std::string control_yaml(const RoomInputs& in) {
  const double kilo = std::max(20.0, 0.85 * in.structure.gripper_opening_m * 750);
  std::ostringstream out;
  out << header(in, "Control loop")
      << "policy_memory_s: 0.25\ndegraded_memory_s: 0.5\nreading_memory_s: 0.02\n"
      << "status_rate_hz: 10\n\nestimator:\n";
  if (drives(in)) {
    out << "  gyro_bias_time_constant_s: 2.0\n  still_wheel_speed_radps: 0.02\n"
        << "  still_time_s: 0.3\n";
  }
  out << "  wrench_link: " << in.structure.wrench_link << "\n\nwhole_body:\n"
      << "  # Guessed: 17 rad/s, 0.8 of critical damping, on the largest inertia that a drive "
         "moves, "
         "its rotor\n  # included; at least so stiff that friction leaves 0.008 rad.\n"
      << "  stiffness_nmprad: " << numbers(each(in, [&](auto j) { return stiffness(in, j); }))
      << "\n  damping_nmsprad: " << numbers(each(in, [&](auto j) { return damping(in, j); }))
      << "\n  admittance:\n    translation_damping_nspm: 800\n    rotation_damping_nmsprad: 40\n"
      << "    translation_max_mps: 0.05\n    rotation_max_radps: 0.2\n    least_singular_value: "
         "0.05\n"
      << "\n# Mabi-Mobile's, tuned there.\nsequencer:\n"
      << "  time_limits: {approach_s: 30, pre_grasp_s: 8, grasp_s: 5, manipulate_s: 15, release_s: "
         "2, "
         "retreat_s: 5}\n"
      << "  pre_grasp_standoff_m: 0.10\n  grasp_depth_m: 0.002\n  regrasp_step_m: 0.010\n"
      << "  probe_distance_m: 0.02\n  probe_held_n: 3.0\n  grasp_tolerance_m: 0.005\n"
      << "  grasp_speed_mps: 0.12\n  retreat_distance_m: 0.12\n  retreat_speed_mps: 0.2\n"
      << "  hand_tolerance_m: 0.012\n  hand_tolerance_rad: 0.08\n  move_tolerance_m: 0.025\n  "
         "move_tolerance_rad: 0.016\n"
      << "  grip_force_n: " << number(std::min(60.0, kilo)) << "\n  grip_settle_s: 0.25\n"
      << "  closed_margin_m: 0.004\n  slip_m: 0.05\n  prismatic_speed_mps: 0.15\n"
      << "  revolute_speed_radps: 0.35\n  lag_max_m: 0.06\n  lag_max_rad: 0.12\n"
      << "  opened_fraction: 0.95\n  progress_timeout_s: 4\n";
  if (drives(in)) {
    out << "  reach_distance_m: " << number(std::min(1.0, rounded(0.7 * in.reach_m)))
        << "\n  base_tolerance_m: 0.15\n  base_tolerance_rad: 0.2\n";
  }
  return out.str();
}

std::string sim_yaml(const RoomInputs& in) {
  const auto values = [&](double (*rule)(const RoomInputs&, std::size_t), double factor) {
    return by_joint(in, each(in, [&](auto j) { return factor * rule(in, j); }));
  };
  std::ostringstream out;
  out << header(in, "The simulated plant")
      << "# Guessed; rotors by the torque limit, which would turn each alone by 250 rad/s2.\n"
      << "step_us: 2500\nimu: " << in.structure.imu << "\nwrench_link: " << in.structure.wrench_link
      << "\narmature_kgm2: " << values(rotor, 1) << "\nhold_nmprad: " << values(stiffness, 1)
      << "\nhold_nmsprad: " << values(damping, 1) << "\ndamped_nmsprad: " << values(damping, 0.4)
      << "\n";
  if (drives(in)) {
    out << "wheels:\n  armature_kgm2: 0.2\n  servo_nmsprad: 100\n  brake_nmprad: 2000\n"
        << "  brake_nmsprad: 40\n";
    out << (in.structure.base == ImportedBase::kOmnidirectional
                ? "  roller_slip_nspm: 2000\n  roller_friction: 0.8\n"
                : "  friction: [1.0, 0.005, 0.0001]\n");
    out << "castors:\n  collisions: " << names(in.structure.castors)
        << "\n  friction: [0.01, 0.0001, 0.00001]\n";
  }
  if (!in.structure.fingers.empty()) {
    out << "gripper:\n  armature_kg: 0.2\n  pads: " << names(in.pads)
        << "\n  friction: [1.0, 0.01, 0.0002]\n  servo_npm: 20000\n  servo_nspm: 80\n"
        << "  speed_mps: 0.1\n  force_max_n: 70\n";
  }
  out << "colours:\n  default: [0.85, 0.86, 0.88]\n  " << in.robot.base.link
      << ": [0.20, 0.23, 0.28]\n";
  return out.str();
}

}  // namespace wb
