#include "core/model/import/urdf_import.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <random>
#include <set>
#include <sstream>

#include "core/config/config.hpp"
#include "core/model/import/contact_exclusion.hpp"
#include "core/model/import/room_files.hpp"

namespace wb {
namespace {

namespace fs = std::filesystem;
using Eigen::Isometry3d;
using Eigen::Vector3d;

std::string percent(double share) {
  std::ostringstream out;
  out.precision(3);
  out << 100 * share << " %";
  return out.str();
}
std::string millimetres(double m) { return std::to_string(std::lround(1000 * m)) + " mm"; }

// A URDF says nothing of rotors, which outweigh the links behind a wrist's joints: a drive's torque
// limit turns its rotor alone by this.
constexpr double kRotor_radps2 = 250;

class Import {
 public:
  Import(const fs::path& urdf, fs::path folder, const ImportOptions& options)
      : options_(options),
        folder_(std::move(folder)),
        document_(UrdfDocument::read(urdf, options.packages)) {
    report_.folder = folder_;
    in_.source = urdf.filename().string();
    in_.structure = find_structure(document_, options.structure);
    in_.robot.name = options.name;
    in_.robot.folder = folder_;
    in_.robot.urdf = folder_ / "robot.urdf";
    // Only the arm is sampled: the base stays at the origin.
    in_.robot.base.kind = BaseKind::kFixed;
    in_.robot.base.link = document_.root;
    in_.robot.end_effector = in_.structure.end_effector;
    in_.robot.fingers = in_.structure.fingers;
    for (const std::string& joint : in_.structure.joints) {
      in_.robot.joints.push_back({joint, 1.0});
      in_.prismatic.push_back(document_.joint(joint)->type == UrdfJoint::Type::kPrismatic);
    }
  }

  ImportReport run() {
    gather_bodies();
    replace_meshes();
    document_.name = options_.name;
    document_.write(in_.robot.urdf, "Written by `wbctl robot import` from " + in_.source +
                                        ": what the controller cannot move is fixed, meshes are "
                                        "the capsules fitted to them. SI units.");
    fit_capsules_to_bodies();
    fit_spheres_to_bodies();
    // Where no posture keeps all pairs apart, those that are nearest most often are given up first.
    for (const double always : {0.75, 0.5, 0.3}) {
      choose_pairs(always);
      if (choose_postures()) break;
    }
    if (!report_.postures.collision_free) refuse_postures();
    describe_postures();
    guess_dynamics();
    find_support();
    in_.excluded =
        excluded_contacts(document_, in_.structure, RobotModel(in_.robot), options_.sampling.seed);
    report_.excluded = static_cast<int>(in_.excluded.size());
    for (const std::string& finger : in_.structure.fingers) {
      for (const UrdfCollision& c : document_.link(document_.joint(finger)->child).collisions)
        in_.pads.push_back(c.name);
    }
    write("robot.yaml", robot_yaml(in_));
    write("mpc.yaml", mpc_yaml(in_));
    write("route.yaml", route_yaml(in_));
    write("mapping.yaml", mapping_yaml(in_));
    write("control.yaml", control_yaml(in_));
    write("sim.yaml", sim_yaml(in_));
    report_.structure = in_.structure;
    report_.notes = in_.structure.notes;
    return report_;
  }

 private:
  void note(const std::string& text) { in_.structure.notes.push_back(text); }

  void write(const char* file, const std::string& text) const {
    std::ofstream out(folder_ / file);
    out << text;
    if (!out.flush()) throw config::ConfigError((folder_ / file).string() + ": cannot be written");
  }

  // 0 is the base, i what joint i - 1 moves; fingers and wheels belong to what carries them.
  int body_of(const std::string& link) const {
    int body = 0;
    for (const UrdfJoint* j : document_.path_to(link)) {
      const auto& joints = in_.structure.joints;
      const auto at = std::find(joints.begin(), joints.end(), j->name);
      if (at != joints.end()) body = static_cast<int>(at - joints.begin()) + 1;
    }
    return body;
  }
  std::string body_link(std::size_t body) const {
    return body == 0 ? document_.root : document_.joint(in_.structure.joints[body - 1])->child;
  }

  void gather_bodies() {
    bodies_.resize(in_.structure.joints.size() + 1);
    const auto poses = document_.poses();
    for (const UrdfLink& link : document_.links) {
      const auto body = static_cast<std::size_t>(body_of(link.name));
      const Isometry3d X_BL = poses.at(body_link(body)).inverse() * poses.at(link.name);
      const UrdfJoint* up = document_.joint_above(link.name);
      const auto& fingers = in_.structure.fingers;
      const bool finger =
          up && std::find(fingers.begin(), fingers.end(), up->name) != fingers.end();
      for (const UrdfCollision& c : link.collisions) {
        if (!finger) {
          bodies_[body].push_back(c.solid.moved(X_BL));
          continue;
        }
        for (const double q : {up->limit->lower, up->limit->upper})  // both ends of the stroke
          bodies_[body].push_back(c.solid.moved(X_BL * Eigen::Translation3d(q * up->axis)));
      }
    }
    for (std::size_t i = 1; i < bodies_.size(); ++i) {
      if (bodies_[i].empty())
        note("link " + body_link(i) + " has no collision shape: nothing guards it");
    }
  }

  void replace_meshes() {
    int meshes = 0;
    double overhang = 0;
    for (UrdfLink& link : document_.links) {
      std::vector<UrdfCollision> kept;
      for (const UrdfCollision& c : link.collisions) {
        if (c.solid.kind != Solid::Kind::kMesh) {
          kept.push_back(c);
          continue;
        }
        ++meshes;
        const CapsuleFit fit = fit_capsules({c.solid}, 3, 0.02);
        overhang = std::max(overhang, fit.quality.overhang_m);
        int k = 0;
        for (const FittedCapsule& capsule : fit.capsules) {
          for (const Solid& s : solids_of(capsule)) {
            kept.push_back({c.name + "_" + std::to_string(k++), s, ""});
          }
        }
      }
      link.collisions = std::move(kept);
    }
    if (meshes > 0) {
      note("meshes: " + std::to_string(meshes) +
           " collision meshes stand in robot.urdf as cylinders "
           "with round ends, which reach up to " +
           millimetres(overhang) + " beyond them");
    }
  }

  static std::vector<Solid> solids_of(const FittedCapsule& c) {
    std::vector<Solid> out;
    const Vector3d axis = c.p1 - c.p0;
    const bool long_one = axis.norm() > 1e-3;
    for (const Vector3d& p :
         long_one ? std::vector<Vector3d>{c.p0, c.p1} : std::vector<Vector3d>{c.p0}) {
      Solid ball;
      ball.kind = Solid::Kind::kSphere;
      ball.half.setConstant(c.radius);
      ball.X_LS.translation() = p;
      out.push_back(ball);
    }
    if (!long_one) return out;
    Solid tube;
    tube.kind = Solid::Kind::kCylinder;
    tube.half = {c.radius, c.radius, 0.5 * axis.norm()};
    tube.X_LS.translation() = 0.5 * (c.p0 + c.p1);
    tube.X_LS.linear() = Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), axis).matrix();
    out.push_back(tube);
    return out;
  }

  static void worsen(FitQuality& worst, const FitQuality& q) {
    worst.coverage = std::min(worst.coverage, q.coverage);
    worst.sticks_out_m = std::max(worst.sticks_out_m, q.sticks_out_m);
    worst.overhang_m = std::max(worst.overhang_m, q.overhang_m);
  }

  void fit_capsules_to_bodies() {
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const CapsuleFit fit = fit_capsules(bodies_[i], i == 0 ? 5 : 2, 0.04);
      int k = 0;
      for (const FittedCapsule& c : fit.capsules) {
        in_.robot.capsules.push_back(
            {body_link(i) + "_" + std::to_string(k++), body_link(i), c.p0, c.p1, c.radius});
      }
      worsen(report_.capsule_fit, fit.quality);
    }
    report_.capsules = static_cast<int>(in_.robot.capsules.size());
  }

  void fit_spheres_to_bodies() {
    const std::vector<SphereFit> fits = fit_spheres(bodies_, options_.spheres, 0.04);
    for (std::size_t i = 0; i < fits.size(); ++i) {
      for (const FittedSphere& s : fits[i].spheres)
        in_.robot.spheres.push_back({body_link(i), s.centre, s.radius, false});
      worsen(report_.sphere_fit, fits[i].quality);
    }
    report_.spheres = static_cast<int>(in_.robot.spheres.size());
    std::ostringstream text;
    const FitQuality &s = report_.sphere_fit, &c = report_.capsule_fit;
    text << "Fitted to the collision shapes of each moving body. Spheres: " << percent(s.coverage)
         << " of the surface samples inside, the furthest " << millimetres(s.sticks_out_m)
         << " outside, overhang up to " << millimetres(s.overhang_m)
         << ". Capsules: " << percent(c.coverage) << ", overhang up to "
         << millimetres(c.overhang_m)
         << ".\n# Masked: within 0.3 m of the hand, on its last three bodies.";
    in_.shapes_comment = text.str();
  }

  void choose_pairs(double always) {
    in_.robot.self_pairs.clear();
    report_.apart = report_.always_near = 0;
    const RobotModel model(in_.robot);
    const std::vector<PairSample> all = sample_pairs(model, options_.sampling, always);
    std::string near;
    for (const PairSample& p : all) {
      const std::array<std::string, 2> names{in_.robot.capsules[p.pair[0]].name,
                                             in_.robot.capsules[p.pair[1]].name};
      if (p.verdict == PairSample::Verdict::kKept) in_.robot.self_pairs.push_back(names);
      report_.apart += p.verdict == PairSample::Verdict::kApart;
      if (p.verdict == PairSample::Verdict::kAlwaysNear) {
        ++report_.always_near;
        near += "\n#   " + names[0] + ", " + names[1] + ": " + percent(p.near);
      }
    }
    report_.pairs = static_cast<int>(in_.robot.self_pairs.size());
    std::ostringstream text;
    text << "Of " << all.size() << " pairs of bodies that are not neighbours, sampled in "
         << std::max(200, options_.sampling.samples / 5) << " postures (seed "
         << options_.sampling.seed << "), " << report_.apart
         << " are kept apart by the joints (never nearer than " << millimetres(kPairDistance_m)
         << ", or often and never touching) and are left out; so are " << report_.always_near
         << " that were nearer in more than " << percent(always) << " of them"
         << (near.empty() ? "." : ":") << near;
    in_.pairs_comment = text.str();
  }

  bool choose_postures() {
    const RobotModel model(in_.robot);
    double front = -1e9;
    if (in_.structure.base != ImportedBase::kFixed) {
      for (const Sphere& s : model.spheres()) {
        if (s.body == 0) front = std::max(front, s.centre.x() + s.radius);
      }
    }
    report_.postures = find_postures(model, front, options_.sampling);
    return report_.postures.collision_free;
  }

  [[noreturn]] void refuse_postures() const {
    throw config::ConfigError(
        document_.file.string() +
        ": no posture was found that keeps the arm from itself with the hand before the robot, "
        "in " +
        std::to_string(options_.sampling.samples) +
        " samples; try more with --samples, another --end-effector, or check the joints' limits");
  }

  void describe_postures() {
    const RobotModel model(in_.robot);
    const Postures& p = report_.postures;
    in_.robot.stowed = p.stowed;
    in_.robot.ready = p.ready;
    in_.robot.base.bounding_radius_m = std::ceil(100 * p.stowed_radius_m) / 100;
    in_.reach_m = arm_reach(model);
    in_.limit_reach = limit_reach(model);
    const RobotModel::Data stowed = arm_data(model, p.stowed), ready = arm_data(model, p.ready);
    for (const Sphere& s : model.spheres())
      in_.height_m = std::max(in_.height_m, (stowed.X_WL[s.body] * s.centre).z() + s.radius);
    for (std::size_t i = 0; i < in_.robot.spheres.size(); ++i) {
      const Sphere& s = model.spheres()[i];
      const double away = (ready.X_WL[s.body] * s.centre - p.p_BE_ready).norm();
      in_.robot.spheres[i].masked = s.body > 0 && s.body + 3 > model.joints() && away < 0.3;
    }
    std::ostringstream stow, hand;
    stow << "least circle of " << options_.sampling.samples << " samples: " << p.stowed_radius_m
         << " m, pairs " << millimetres(p.stowed_distance_m) << " apart";
    hand << "hand at (" << p.p_BE_ready.x() << ", " << p.p_BE_ready.y() << ", " << p.p_BE_ready.z()
         << ") m in B, " << p.ready_angle_rad << " rad off straight forward; pairs "
         << millimetres(p.ready_distance_m) << " apart";
    in_.stowed_comment = stow.str();
    in_.ready_comment = hand.str();
    if (!p.path_free) note("postures: the straight way from stowed to ready comes near itself");
    if (p.ready_angle_rad > 0.05)
      note("ready: the arm cannot point the hand straight forward there; it is " +
           std::to_string(p.ready_angle_rad) + " rad off");
  }

  void guess_dynamics() {
    const RobotModel model(in_.robot);
    const ArmRange range = arm_range(model);
    const int n = model.joints();
    in_.inertia.assign(static_cast<std::size_t>(n), 0);
    std::vector<double> load(static_cast<std::size_t>(n));
    std::mt19937_64 random(options_.sampling.seed);
    for (int k = 0; k < 500; ++k) {
      std::vector<double> q;
      for (int j = 0; j < n; ++j) {
        const double share = static_cast<double>(random() >> 11) * 0x1.0p-53;
        q.push_back(range.lower[j] + share * (range.upper[j] - range.lower[j]));
      }
      JointMatrix M;
      JointVector g;
      model.mass_matrix(q.data(), M);
      model.gravity(q.data(), g);
      for (int j = 0; j < n; ++j) {
        in_.inertia[j] = std::max(in_.inertia[j], M(j, j));
        load[j] = std::max(load[j], std::abs(g[j]));
      }
    }
    for (int j = 0; j < n; ++j) {
      JointLimits l = model.limits(j);
      if (load[j] > l.torque) {
        std::ostringstream text;
        text << "joint " << in_.robot.joints[j].name << ": gravity can ask for " << load[j]
             << ", its limit is " << l.torque << (in_.prismatic[j] ? " N" : " Nm");
        note(text.str());
      }
      in_.rotor.push_back(l.torque / kRotor_radps2);
      in_.inertia[j] += in_.rotor.back();
      in_.friction.push_back(document_.joint(in_.robot.joints[j].name)->friction);
      const double spare = 0.5 * std::max(0.0, l.torque - load[j]) / in_.inertia[j];
      l.acceleration = std::max(l.velocity, std::min(l.velocity / 0.3, spare));
      const double unit = std::pow(10, std::floor(std::log10(l.acceleration)) - 1);
      l.acceleration = std::round(l.acceleration / unit) * unit;
      in_.robot.joints[j].acceleration_max = l.acceleration;
      in_.limits.push_back(l);
    }
    const RobotStructure& s = in_.structure;
    if (s.base == ImportedBase::kFixed) return;
    in_.velocity_max_mps = std::min(1.0, s.wheel_speed_radps * s.wheel_radius_m);
    const double lever = 0.5 * (s.track_m + s.wheelbase_m);
    in_.yaw_rate_max_radps = std::min(1.0, in_.velocity_max_mps / lever);
  }

  // The largest circle about the contacts' middle that lies between them.
  void find_support() {
    std::vector<Eigen::Vector2d> contacts;
    const auto poses = document_.poses();
    for (const std::string& wheel : in_.structure.wheels)
      contacts.emplace_back(poses.at(document_.joint(wheel)->child).translation().head<2>());
    for (const UrdfLink& link : document_.links) {
      for (const UrdfCollision& c : link.collisions) {
        const auto& castors = in_.structure.castors;
        if (std::find(castors.begin(), castors.end(), c.name) != castors.end())
          contacts.emplace_back((poses.at(link.name) * c.solid.X_LS.translation()).head<2>());
      }
    }
    if (contacts.size() < 3) return;
    Eigen::Vector2d low = contacts[0], high = contacts[0];
    for (const Eigen::Vector2d& p : contacts) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    in_.support_centre_m = 0.5 * (low + high);
    // Of the support function about the centre; many directions stand for the hull's edges.
    in_.support_radius_m = 1e9;
    for (int k = 0; k < 360; ++k) {
      const double a = k * std::numbers::pi / 180;
      double reach = -1e9;
      for (const Eigen::Vector2d& p : contacts)
        reach = std::max(reach,
                         (p - in_.support_centre_m).dot(Eigen::Vector2d(std::cos(a), std::sin(a))));
      in_.support_radius_m = std::min(in_.support_radius_m, reach);
    }
    // The robot must stand on it stowed, or it is no support.
    if (in_.support_radius_m <= 0.03) in_.support_radius_m = 0;
  }

  ImportOptions options_;
  fs::path folder_;
  UrdfDocument document_;
  RoomInputs in_;
  ImportReport report_;
  std::vector<std::vector<Solid>> bodies_;  // in the frame of body_link()
};

}  // namespace

ImportReport import_urdf(const fs::path& urdf, const fs::path& folder,
                         const ImportOptions& options) {
  return Import(urdf, folder, options).run();
}

}  // namespace wb
