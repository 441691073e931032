#include "drivers/plant/dds_side.hpp"

#include <ctime>
#include <limits>

#include "core/rt/executor.hpp"

namespace wb::plant {
namespace {

constexpr TimeNs kTruthPeriodNs = 10'000'000;

TimeNs ros_now() {
  timespec t;
  clock_gettime(CLOCK_REALTIME, &t);
  return t.tv_sec * kNanosPerSecond + t.tv_nsec;
}

// The robot's own links, cameras among them.
std::vector<std::string> robot_links(const SimulatedRobot& robot) {
  const mjModel& model = robot.driver()->plant.model();
  const int base = robot.driver()->plant.body(robot.driver()->config.robot.base.link);
  std::vector<std::string> out;
  for (int b = 0; b < model.nbody; ++b) {
    if (model.body_rootid[b] == model.body_rootid[base] && b != 0)
      out.emplace_back(mj_id2name(&model, mjOBJ_BODY, b));
  }
  return out;
}

}  // namespace

wb_description DdsSide::described(const SimulatedRobot& robot, const DdsOptions& options) {
  wb_description d = robot.description();
  if (!options.joints) d.joint_count = 0;
  for (std::uint32_t i = 0; i < d.joint_count; ++i)
    d.joints[i].command_kinds =
        d.joints[i].is_wheel ? 1u << WB_CMD_VELOCITY
                             : 1u << WB_CMD_IMPEDANCE | 1u << WB_CMD_POSITION | 1u << WB_CMD_TORQUE;
  d.has_gripper = d.has_gripper && options.gripper;
  return d;
}

dds::LowLevelOptions DdsSide::low_level(const SimulatedRobot& robot, const DdsOptions& options) {
  dds::LowLevelOptions out;
  out.domain = options.domain;
  out.prefix = options.prefix;
  out.paced = options.paced;
  const wb_description& d = robot.description();
  for (std::uint32_t i = 0; i < d.camera_count; ++i) {
    const wb_camera_info& c = d.cameras[i];
    out.cameras.push_back({c.name, options.prefix + "/" + c.name + "/image",
                           static_cast<int>(c.width), static_cast<int>(c.height), c.fx, c.fy, c.cx,
                           c.cy});
  }
  return out;
}

DdsSide::DdsSide(SimulatedRobot& robot, const DdsOptions& options)
    : robot_(robot),
      options_(options),
      links_(robot_links(robot)),
      low_level_(low_level(robot, options), described(robot, options), *this) {}

void DdsSide::read(wb_readings& readings) {
  readings = robot_.readings();
  for (std::uint32_t i = 0; i < robot_.description().joint_count; ++i) {
    readings.joints[i].valid = options_.joints && readings.joints[i].valid;
    readings.joints[i].status = WB_JOINT_UNKNOWN;  // the low level knows who commands them
  }
  // The newest sample's stamp, on the protocol's clock.
  const TimeNs age = robot_.now() - readings.t_ns;
  readings.t_ns = (options_.paced ? robot_.now() + clock_less_plant_ns_ : ros_now()) - age;
}

void DdsSide::apply(const wb_commands& commands) {
  if (options_.gripper) robot_.grip(commands.gripper.opening, commands.gripper.force);
  if (!options_.joints) return;
  for (std::uint32_t i = 0; i < robot_.description().joint_count; ++i) {
    const auto& c = commands.joints[i];
    JointTarget t{
        JointTarget::Kind::kBrake, c.position, c.velocity, c.effort, c.stiffness, c.damping};
    switch (c.kind) {
      case WB_CMD_IMPEDANCE:
        t.kind = JointTarget::Kind::kImpedance;
        break;
      case WB_CMD_VELOCITY:
        t.kind = JointTarget::Kind::kVelocity;
        break;
      case WB_CMD_POSITION:
        t.kind = JointTarget::Kind::kPosition;
        break;
      case WB_CMD_TORQUE:
        t.kind = JointTarget::Kind::kTorque;
        break;
      default:
        break;
    }
    robot_.set(static_cast<int>(i), t);
  }
}

// Every action is the brakes' of the simulated servos: a joint is held where it is, a wheel stands.
void DdsSide::stop(const wb_timeout_action*) {
  if (!options_.joints) return;
  for (std::uint32_t i = 0; i < robot_.description().joint_count; ++i)
    robot_.set(static_cast<int>(i), {});
}

bool DdsSide::advance(TimeNs t) {
  try {
    if (options_.advances) robot_.advance(t);
  } catch (const std::exception&) {
    return false;
  }
  clock_less_plant_ns_ = t - robot_.now();
  publish(clock_less_plant_ns_);
  return true;
}

void DdsSide::publish() { publish(ros_now() - robot_.now()); }

void DdsSide::publish(TimeNs clock_less_plant_ns) {
  wb_frame frame;
  while (robot_.next_frame(frame)) {
    low_level_.publish_depth(static_cast<int>(frame.camera), frame.t_ns + clock_less_plant_ns,
                             frame.depth);
    robot_.release(frame);
  }
  if (!options_.truth || robot_.now() < next_truth_ns_) return;
  next_truth_ns_ = robot_.now() + kTruthPeriodNs;
  publish_truth(robot_.now() + clock_less_plant_ns);
}

void DdsSide::publish_truth(TimeNs t_ns) {
  const wb_sim_truth& source = robot_.truth();
  wb_driver* driver = robot_.driver();
  truth_.t_ns = t_ns;
  truth_.base_pose = source.base_pose(driver);
  truth_.spawn_pose = source.spawn_pose(driver);
  truth_.objects.resize(source.object_count(driver));
  for (std::uint32_t i = 0; i < truth_.objects.size(); ++i) {
    auto& o = truth_.objects[i];
    source.object(driver, i, &o.object);
    source.hand_in_handle(driver, i, &o.X_GE);
    o.clearance = std::numeric_limits<double>::quiet_NaN();  // 0.13 ms each: nobody asks for it
  }
  truth_.contact_count = source.contact_count(driver);
  truth_.contacts.resize(std::min<std::uint32_t>(truth_.contact_count, 64));
  for (std::uint32_t i = 0; i < truth_.contacts.size(); ++i) {
    source.contact(driver, i, &truth_.contacts[i]);
    truth_.contacts[i].t_ns += t_ns - robot_.now();
  }
  truth_.links.clear();
  for (const std::string& link : links_) {
    wb_sim_pose pose;
    if (source.link_pose(driver, link.c_str(), &pose) == WB_OK)
      truth_.links.emplace_back(link, pose);
  }
  truth_.clearance = std::numeric_limits<double>::quiet_NaN();
  truth_.frames_dropped = source.frames_dropped(driver);
  low_level_.publish_truth(truth_);
}

}  // namespace wb::plant
