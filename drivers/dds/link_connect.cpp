// The start of a Link: entities, and waiting for all that the configuration names. Setup world.
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <random>

#include "drivers/dds/link_dds.hpp"

namespace wb::dds {
namespace {

constexpr TimeNs kLookNs = 20'000'000;

std::uint64_t random_number() {
  std::random_device random;
  std::uint64_t number = 0;
  while (number == 0) number = (std::uint64_t{random()} << 32) | random();
  return number;
}

void wait_for(const std::string& what, TimeNs timeout_ns, Doorbell& doorbell,
              const std::function<bool()>& condition) {
  const TimeNs end = clock_ns(CLOCK_MONOTONIC) + timeout_ns;
  while (!condition()) {
    if (clock_ns(CLOCK_MONOTONIC) > end) {
      throw config::ConfigError("nothing came within " + std::to_string(timeout_ns / 1'000'000) +
                                " ms: " + what +
                                " (is the low-level computer on, in the same DDS domain?)");
    }
    doorbell.wait(kLookNs);
  }
}

}  // namespace

Link::Link(const DdsConfig& config, Exchange& exchange, Counters& counters)
    : config_(config),
      exchange_(exchange),
      counters_(counters),
      dds_(std::make_unique<Dds>()),
      setup_(std::make_unique<Setup>()) {
  Dds& d = *dds_;
  char host[64] = {};
  gethostname(host, sizeof host - 1);
  d.holder = "wb_driver_dds on " + std::string(host).substr(0, 24) + ", process " +
             std::to_string(getpid());
  d.participant = make_participant(config.domain, d.holder);
  const auto topic = [&](const char* name) { return robot_topic(config.prefix, name); };
  const auto reader = [&]<class M>(std::optional<Reader<M>>& r, const std::string& name,
                                   const Profile& profile) {
    r.emplace(d.participant, name, profile);
    wake_on_data(*r, exchange_.to_thread);
  };
  const Profile stream = config.paced ? kEvents : kStreamReader;
  if (config.measurements()) {
    Profile latched = kLatched;
    latched.depth = 4;  // of several starts of the low-level computer
    reader(d.description, topic("robot_description"), latched);
  }
  if (config.commands()) {
    reader(d.grants, topic("lease_grant"), kEvents);
    d.lease_requests.emplace(d.participant, topic("lease_request"), kEvents);
    d.commands.emplace(d.participant, topic("joint_commands"), kNewest);
  }
  if (config.paced) d.ticks.emplace(d.participant, topic("tick"), kNewest);
  if (!config.imu.empty() && config.imu != DdsConfig::kMeasurements)
    reader(d.imu, "rt/" + config.imu, kStreamReader);
  if (!config.wrench.empty() && config.wrench != DdsConfig::kMeasurements)
    reader(d.wrench, "rt/" + config.wrench, kStreamReader);
  if (config.truth) reader(d.truth, topic("truth"), kEvents);
  for (const CameraSource& source : config.cameras) {
    Dds::Camera& camera = d.cameras.emplace_back();
    if (source.points) {
      reader(camera.points, "rt/" + source.topic, stream);
    } else {
      reader(camera.image, "rt/" + source.topic, stream);
    }
    reader(camera.info, "rt/" + source.info, kStreamReader);
  }
  connect();
}

// The reader of measurements comes last: discovery is in order, so whoever answers on it knows our
// other readers already, and a paced robot's first frames and truth reach us.
void Link::connect() {
  Dds& d = *dds_;
  Doorbell& doorbell = exchange_.to_thread;
  const TimeNs timeout = config_.connect_timeout_ns;
  const auto topic = [&](const char* name) { return robot_topic(config_.prefix, name); };

  description_ = {};
  copy_text(description_.name, "dds:" + config_.prefix);
  if (d.description) {
    std::string mismatch;
    wait_for("topic " + topic("robot_description"), timeout, doorbell, [&] {
      d.description->take([&](const msg::RobotDescription& robot) {
        if (robot.paced_ != config_.paced) {
          mismatch = robot.paced_ ? "is paced" : "is not paced";
          return;
        }
        mismatch.clear();
        adopt(robot);
      });
      return boot_ != 0 || !mismatch.empty();
    });
    if (!mismatch.empty())
      throw config::ConfigError("driver dds: the robot behind '" + config_.prefix + "' " +
                                mismatch + ", 'clock' says otherwise");
  }
  describe();

  announced_.resize(config_.cameras.size(), -1);
  for (std::size_t i = 0; i < config_.cameras.size(); ++i) {
    const CameraSource& source = config_.cameras[i];
    Camera& camera = cameras_.emplace_back();
    wait_for("camera " + source.name + ": topic rt/" + source.info + " with a usable CameraInfo",
             timeout, doorbell, [&] {
               d.cameras[i].info->take([&](const msg::CameraInfo& info) {
                 counters_.count(Stream::kFrames, read_camera_info(info, camera.model));
               });
               return camera.model.pixels() > 0;
             });
    wait_for("camera " + source.name + ": topic rt/" + source.topic, timeout, doorbell,
             [&] { return d.cameras[i].matched(); });
    camera.ring = std::make_unique<FrameRing>(camera.model.pixels());
    wb_camera_info& out = description_.cameras[description_.camera_count++];
    copy_text(out.name, source.name);
    const CameraModel& model = camera.model;
    out = {{},       model.width,        model.height,       model.fx,       model.fy, model.cx,
           model.cy, source.range_min_m, source.range_max_m, source.rate_hz, 0};
    copy_text(out.name, source.name);
  }
  if (d.truth)
    wait_for("topic " + topic("truth"), timeout, doorbell, [&] { return d.truth->matched(); });
  if (d.commands)
    wait_for("a reader of " + topic("joint_commands") + " and " + topic("lease_request"), timeout,
             doorbell, [&] { return d.commands->matched() && d.lease_requests->matched(); });
  if (d.description) {
    d.measurements.emplace(d.participant, topic("joint_measurements"),
                           config_.paced ? kEvents : kStreamReader);
    wake_on_data(*d.measurements, doorbell);
  }
  if (config_.paced) {
    bool answered = false;
    wait_for("an answer to " + topic("tick"), timeout, doorbell, [&] {
      d.measurements->take(
          [&](const msg::JointMeasurements& m) { answered = answered || m.session_ == session_; });
      if (!answered) d.ticks->write({session_, 0, 0, 0, 0});
      return answered;
    });
  }

  setup_->thread = std::thread([this] { run(); });
  try {
    // The thread is at work: what it leaves in the exchange tells the rest.
    if (config_.paced) {
      exchange_.tick_t_ns = 0;
      exchange_.tick_asked = 1;
      doorbell.ring();
      wait_for("the first tick's measurements, frames and truth", timeout, exchange_.to_control,
               [&] { return exchange_.tick_done >= 1; });
    }
    const auto wait = [&](const std::string& what, const std::function<bool()>& condition) {
      wait_for(what, timeout, exchange_.to_control, condition);
    };
    if (d.measurements)
      wait("topic " + topic("joint_measurements") + " (wb.diagnostics/1 counts what was refused)",
           [&] { return exchange_.measurements.read() != nullptr; });
    if (d.imu) wait("topic rt/" + config_.imu, [&] { return exchange_.imu.read() != nullptr; });
    if (d.wrench)
      wait("topic rt/" + config_.wrench, [&] { return exchange_.wrench.read() != nullptr; });
    if (d.truth) wait("topic " + topic("truth"), [&] { return truth_.newest().seq > 0; });
  } catch (...) {
    stopping_ = true;
    doorbell.ring();
    setup_->thread.join();
    throw;
  }
}

// The description that the daemon sees: the parts that the configuration takes.
void Link::describe() {
  description_.has_imu = !config_.imu.empty();
  description_.has_wrench = !config_.wrench.empty();
  description_.has_gripper = config_.gripper;
  description_.can_step = config_.paced;
}

// A low-level computer that has started: the first one, or the same robot's again.
void Link::adopt(const msg::RobotDescription& robot) {
  const bool first = boot_ == 0;
  if (robot.boot_ == 0 || robot.boot_ == boot_) return;
  std::vector<wb_joint_info> infos;
  std::vector<std::uint32_t> joints;
  const auto fail = [&](const std::string& message) {
    if (first)
      throw config::ConfigError("driver dds: robot '" + std::string(robot.name_) + "' " + message);
  };
  if (robot.joints_._length > WB_DRIVER_MAX_JOINTS) return fail("has too many joints");
  std::vector<std::string> wanted = config_.joints;
  if (config_.all_joints) {
    for (std::uint32_t i = 0; i < robot.joints_._length; ++i)
      wanted.push_back(robot.joints_._buffer[i].name_);
  }
  for (const std::string& name : wanted) {
    std::uint32_t j = 0;
    while (j < robot.joints_._length && name != robot.joints_._buffer[j].name_) ++j;
    if (j == robot.joints_._length) return fail("has no joint '" + name + "'");
    const msg::JointInfo& in = robot.joints_._buffer[j];
    wb_joint_info info{};
    copy_text(info.name, in.name_);
    info.position_min = in.position_min_;
    info.position_max = in.position_max_;
    info.velocity_max = in.velocity_max_;
    info.effort_max = in.effort_max_;
    info.command_kinds = in.command_kinds_;
    info.is_wheel = in.is_wheel_;
    infos.push_back(info);
    joints.push_back(j);
  }
  if (config_.gripper && !robot.has_gripper_) return fail("has no gripper");
  if (config_.imu == DdsConfig::kMeasurements && !robot.has_imu_) return fail("has no IMU");
  if (config_.wrench == DdsConfig::kMeasurements && !robot.has_wrench_)
    return fail("has no wrench sensor");
  if (!first) {
    // Only the same joints at the same places may take over.
    bool same_joints = joints == joints_ && robot.joints_._length == robot_joint_count_;
    for (std::size_t i = 0; same_joints && i < infos.size(); ++i)
      same_joints = std::strcmp(infos[i].name, description_.joints[i].name) == 0;
    if (!same_joints || robot.paced_ != config_.paced) {
      counters_.count(Stream::kSamples, Fault::kWrongSource);
      return;
    }
  } else {
    description_.joint_count = static_cast<std::uint32_t>(infos.size());
    std::copy(infos.begin(), infos.end(), description_.joints);
    description_.has_emergency_stop = robot.has_emergency_stop_;
    joints_ = joints;
    session_ = config_.paced ? random_number() : 0;
  }
  boot_ = robot.boot_;
  robot_joint_count_ = robot.joints_._length;
  timeout_actions_.clear();
  for (std::uint32_t j = 0; j < robot_joint_count_; ++j)
    timeout_actions_.push_back(robot.joints_._buffer[j].timeout_actions_);
  announced_.assign(config_.cameras.size(), -1);
  for (std::size_t c = 0; c < config_.cameras.size(); ++c) {
    for (std::uint32_t i = 0; i < robot.cameras_._length; ++i) {
      if (config_.cameras[c].topic == robot.cameras_._buffer[i].topic_)
        announced_[c] = static_cast<int>(i);
    }
  }
  for (Camera& camera : cameras_) camera.received = 0;
  gate_.expect(boot_, robot_joint_count_, joints_, session_);
  truth_.expect(boot_);
  if (lease_ != 0) lose_lease();
}

}  // namespace wb::dds
