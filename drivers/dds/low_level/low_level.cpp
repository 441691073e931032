#include "drivers/dds/low_level/low_level.hpp"

#include <time.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <random>

#include "drivers/dds/low_level/command_admission.hpp"
#include "drivers/dds/low_level/lease_book.hpp"
#include "drivers/dds/low_level/robot_messages.hpp"
#include "drivers/dds/low_level/session_clock.hpp"
#include "drivers/dds/low_level/truth_message.hpp"
#include "drivers/dds/messages.hpp"

namespace wb::dds {
namespace {

constexpr TimeNs kDescribePeriodNs = 200'000'000;  // CameraInfo, for whoever starts later

TimeNs clock_ns(clockid_t clock) {
  timespec t;
  clock_gettime(clock, &t);
  return t.tv_sec * kNanosPerSecond + t.tv_nsec;
}

std::string info_topic(const std::string& image_topic) {
  const std::size_t slash = image_topic.rfind('/');
  return (slash == std::string::npos ? "" : image_topic.substr(0, slash + 1)) + "camera_info";
}

}  // namespace

struct LowLevel::Impl {
  struct Camera {
    LowLevelCamera config;
    Writer<msg::Image> image;
    Writer<msg::CameraInfo> info;
    std::uint64_t frames = 0;  // in this session
  };

  const LowLevelOptions options;
  const wb_description robot_info;
  LowLevelRobot& robot;
  LowLevelFaults& faults;
  LowLevelCounts& counts;

  Entity participant;
  Reader<msg::LeaseRequest> lease_requests;
  Reader<msg::JointCommands> commands;
  std::optional<Reader<msg::Tick>> ticks;
  Writer<msg::LeaseGrant> grants;
  Writer<msg::JointMeasurements> measurements;
  Writer<msg::RobotDescription> description;
  Writer<msg::Truth> truth;
  std::vector<Camera> cameras;
  Waitset waitset;

  LeaseBook leases;
  std::uint64_t boot = 0;
  std::array<wb_timeout_action, WB_DRIVER_MAX_JOINTS> actions{};
  CommandAdmission admission;

  std::uint64_t sequence = 0, truth_sequence = 0;
  TimeNs next_publish_ns = 0, next_describe_ns = 0;  // monotonic
  msg::JointMeasurements last{}, held{};             // as sent; kept back to be reordered
  bool have_last = false, have_held = false;
  wb_readings readings{};

  SessionClock clock;       // of a paced robot
  bool other_host = false;  // since the last tick
  Truth last_truth;

  Impl(const LowLevelOptions& o, const wb_description& d, LowLevelRobot& r, LowLevelFaults& f,
       LowLevelCounts& c)
      : options(o),
        robot_info(d),
        robot(r),
        faults(f),
        counts(c),
        participant(make_participant(o.domain, o.prefix + " low level")),
        lease_requests(participant, robot_topic(o.prefix, "lease_request"), kEvents),
        commands(participant, robot_topic(o.prefix, "joint_commands"),
                 o.paced ? kEvents : kStreamReader),
        grants(participant, robot_topic(o.prefix, "lease_grant"), kEvents),
        measurements(participant, robot_topic(o.prefix, "joint_measurements"), kNewest),
        description(participant, robot_topic(o.prefix, "robot_description"), kLatched),
        truth(participant, robot_topic(o.prefix, "truth"), kNewest),
        waitset(participant),
        leases(o.lease_silence_ns),
        admission(d) {
    if (d.joint_count > WB_DRIVER_MAX_JOINTS || o.cameras.size() > 8 ||
        (!o.timeout_actions.empty() && o.timeout_actions.size() != d.joint_count))
      throw config::ConfigError("low level: too many joints or cameras, or time-out actions for " +
                                std::to_string(o.timeout_actions.size()) + " joints");
    std::random_device random;
    boot = (std::uint64_t{random()} << 32) | random();
    waitset.attach(lease_requests.condition());
    waitset.attach(commands.condition());
    if (options.paced) {
      ticks.emplace(participant, robot_topic(o.prefix, "tick"), kEvents);
      waitset.attach(ticks->condition());
    }
    for (const LowLevelCamera& camera : o.cameras) {
      cameras.push_back({camera,
                         {participant, "rt/" + camera.topic, kFrameWriter},
                         {participant, "rt/" + info_topic(camera.topic), kNewest}});
    }
    describe();
  }

  TimeNs monotonic() const { return clock_ns(CLOCK_MONOTONIC); }
  // On the clock of commands' validity.
  TimeNs command_clock() const { return options.paced ? clock.now_ns() : monotonic(); }
  // The stamps' clock.
  TimeNs stamp_now() const { return options.paced ? clock.host_ns() : clock_ns(CLOCK_REALTIME); }

  void describe() {
    std::vector<std::uint32_t> supported;
    for (std::uint32_t i = 0; i < robot_info.joint_count; ++i)
      supported.push_back(supported_actions(i));
    DescriptionMessage message(robot_info, supported, options.cameras);
    message.get().boot_ = boot;
    message.get().paced_ = options.paced;
    description.write(message.get());
  }

  std::uint32_t supported_actions(std::uint32_t joint) const {
    return options.timeout_actions.empty() ? 7u : options.timeout_actions[joint];
  }

  // --- the lease

  void take_lease_requests() {
    lease_requests.take([&](const msg::LeaseRequest& request) {
      if (faults.deaf) return;
      msg::LeaseGrant grant{};
      grant.claim_ = request.claim_;
      grant.silence_ns_ = leases.silence_ns();
      if (request.release_) {
        if (leases.release(request.claim_)) lease_ended();
        copy_text(grant.holder_, leases.holder());
        copy_text(grant.reason_, "released");
        grants.write(grant);
        return;
      }
      std::string reason = check_actions(request);
      LeaseBook::Answer answer;
      if (reason.empty()) {
        answer = leases.ask(request.claim_, request.holder_, monotonic());
        reason = answer.reason;
      }
      if (answer.is_new) {
        for (std::uint32_t i = 0; i < request.joint_count_; ++i)
          actions[i] = static_cast<wb_timeout_action>(request.timeout_action_[i]);
        admission.begin_lease();
        ++counts.leases;
        robot.begin(actions.data());
      }
      if (answer.lease == 0) ++counts.refused_leases;
      grant.lease_ = answer.lease;
      copy_text(grant.holder_, leases.holder());
      copy_text(grant.reason_, reason);
      grants.write(grant);
    });
    if (leases.expire(monotonic())) lease_ended();
  }

  std::string check_actions(const msg::LeaseRequest& request) const {
    if (request.joint_count_ != 0 && request.joint_count_ != robot_info.joint_count)
      return "the robot has " + std::to_string(robot_info.joint_count) + " joints, not " +
             std::to_string(request.joint_count_);
    for (std::uint32_t i = 0; i < request.joint_count_; ++i) {
      if (request.timeout_action_[i] > WB_TIMEOUT_BRAKE ||
          !(supported_actions(i) & (1u << request.timeout_action_[i])))
        return std::string("joint ") + robot_info.joints[i].name + " has no time-out action " +
               std::to_string(request.timeout_action_[i]);
    }
    return "";
  }

  void lease_ended() {
    if (admission.end_lease()) robot.stop(actions.data());
  }

  // --- commands

  void stop_joints() {
    robot.stop(actions.data());
    admission.latch_stop();
  }

  void watch() {
    if (command_clock() <= admission.deadline_ns()) return;
    ++counts.time_outs;
    stop_joints();
  }

  void take_commands() {
    commands.take([&](const msg::JointCommands& command) {
      CommandAdmission::Moment moment;
      moment.lease = leases.lease();
      moment.stamp_ns = stamp_now();
      moment.memory_ns = options.paced ? 0 : options.command_memory_ns;
      moment.now_ns = command_clock();
      moment.emergency_stop = readings.emergency_stop;
      wb_commands out;
      const CommandAdmission::Verdict verdict = admission.take(command, moment, out);
      if (verdict == CommandAdmission::Verdict::kRefused) {
        ++counts.refused_commands;
        return;
      }
      leases.heard(monotonic());
      if (verdict == CommandAdmission::Verdict::kStop) stop_joints();
      if (verdict != CommandAdmission::Verdict::kApply) return;
      if (options.paced) out.t_ns += clock.offset_ns();
      robot.apply(out);
      ++counts.commands;
    });
  }

  // --- measurements

  void read_robot() {
    readings = {};
    robot.read(readings);
    if (readings.emergency_stop && admission.moving()) stop_joints();
    msg::JointMeasurements& out = last;
    if (!faults.frozen || !have_last) {
      out = measurement_message(readings, robot_info.joint_count);
      out.boot_ = boot;
      if (options.paced) out.stamp_ns_ -= clock.offset_ns();
      for (std::uint32_t i = 0; i < out.joint_count_; ++i)
        out.status_[i] = static_cast<std::uint8_t>(status_of(out.status_[i], out.error_[i]));
      have_last = true;
    }
    out.session_ = clock.session();
    out.tick_ = clock.tick();
    out.truth_sequence_ = truth_sequence;
    for (std::size_t i = 0; i < cameras.size(); ++i) out.frames_[i] = cameras[i].frames;
    out.stopped_ = admission.stopped();
    out.lease_ = leases.lease();
    out.command_sequence_ = admission.sequence();
    copy_text(out.refusal_, admission.refusal());
  }

  std::uint32_t status_of(std::uint32_t said, std::uint32_t error) const {
    if (said != WB_JOINT_UNKNOWN) return said;
    if (error != 0) return WB_JOINT_FAULT;
    if (admission.stopped()) return WB_JOINT_STOPPED;
    return admission.commanded() ? WB_JOINT_FOLLOWING : WB_JOINT_DISABLED;
  }

  void publish() {
    read_robot();
    if (faults.silent) return;
    last.sequence_ = ++sequence;
    msg::JointMeasurements out = last;
    if (faults.old_stamps) out.stamp_ns_ -= kNanosPerSecond;
    if (faults.future_stamps) out.stamp_ns_ += 50'000'000;
    if (faults.reorder && !have_held) {
      held = out;
      have_held = true;
      return;
    }
    measurements.write(out);
    if (faults.duplicate) measurements.write(out);
    if (have_held) measurements.write(held);
    have_held = false;
    ++counts.measurements;
  }

  void publish(const Truth& t) {
    TruthMessage message(t, options.paced ? clock.offset_ns() : 0);
    message.get().boot_ = boot;
    message.get().sequence_ = ++truth_sequence;
    truth.write(message.get());
  }

  // --- a paced robot's time

  void take_ticks() {
    std::vector<msg::Tick> waiting;
    ticks->take([&](const msg::Tick& t) { waiting.push_back(t); });
    for (const msg::Tick& t : waiting) follow(t);
  }

  void follow(const msg::Tick& t) {
    const TimeNs now = monotonic();
    const bool other = t.session_ != clock.session();
    const SessionClock::Verdict verdict = clock.take(t, now);
    if (verdict == SessionClock::Verdict::kRefused) {
      ++counts.refused_ticks;
      return;
    }
    if (other) {
      other_host = true;
      for (Camera& camera : cameras) camera.frames = 0;
    }
    if (verdict == SessionClock::Verdict::kGoOn) {
      // The commands of before this tick first: two topics have no order between them.
      while (t.lease_ != 0 && t.lease_ == leases.lease() &&
             admission.heard_sequence() < t.command_sequence_ &&
             monotonic() - now < options.command_wait_ns) {
        waitset.wait(1'000'000);
        take_lease_requests();
        take_commands();
      }
      const TimeNs t_robot = clock.robot_ns(t);
      // valid_for is kept to the nanosecond of virtual time.
      if (t_robot > admission.deadline_ns()) {
        clock.reach(std::max(clock.now_ns(), admission.deadline_ns()));
        if (!robot.advance(clock.now_ns())) return;
        ++counts.time_outs;
        stop_joints();
      }
      // The robot stamps frames and truth that it publishes meanwhile with its own time.
      clock.reach(t_robot);
      const std::uint64_t told = truth_sequence;
      if (!robot.advance(t_robot)) return;  // no answer: the host's advance() fails
      // A new host needs the truth at once, also when none is due.
      if (other_host && told == truth_sequence && told != 0) publish(last_truth);
      other_host = false;
      ++counts.ticks;
    }
    clock.answer(t);
    publish();
  }

  void spin(TimeNs timeout_ns) {
    const TimeNs now = monotonic();
    TimeNs until = now + timeout_ns;
    if (!options.paced) {
      if (next_publish_ns == 0) next_publish_ns = now;
      until = std::min(until, next_publish_ns);
      until = std::min(until, admission.deadline_ns());
    }
    waitset.wait(until - now);
    if (!options.paced) watch();
    take_lease_requests();
    take_commands();
    if (options.paced) {
      take_ticks();
    } else if (monotonic() >= next_publish_ns) {
      publish();
      // Missed releases are left out.
      next_publish_ns += options.period_ns;
      next_publish_ns = std::max(next_publish_ns, monotonic());
    }
    if (monotonic() < next_describe_ns) return;
    next_describe_ns = monotonic() + kDescribePeriodNs;
    for (Camera& camera : cameras) publish_info(camera, stamp_now());
  }

  void publish_info(Camera& camera, TimeNs t_ns) {
    camera.info.write(camera_info_message(camera.config, t_ns));
  }
};

LowLevel::LowLevel(const LowLevelOptions& options, const wb_description& description,
                   LowLevelRobot& robot)
    : impl_(std::make_unique<Impl>(options, description, robot, faults, counts_)) {}
LowLevel::~LowLevel() = default;

void LowLevel::spin(TimeNs timeout_ns) { impl_->spin(timeout_ns); }

void LowLevel::publish_depth(int index, TimeNs t_ns, const float* depth) {
  Impl::Camera& camera = impl_->cameras.at(index);
  const LowLevelCamera& c = camera.config;
  const TimeNs stamp = t_ns - (impl_->options.paced ? impl_->clock.offset_ns() : 0);
  impl_->publish_info(camera, stamp);
  msg::Image out{};
  out.header_ = {to_message(stamp), text(c.name.c_str())};
  out.width_ = static_cast<std::uint32_t>(c.width);
  out.height_ = static_cast<std::uint32_t>(c.height);
  out.encoding_ = text("32FC1");
  out.step_ = out.width_ * sizeof(float);
  out.data_._maximum = out.data_._length = out.step_ * out.height_;
  out.data_._buffer = reinterpret_cast<std::uint8_t*>(const_cast<float*>(depth));
  if (camera.image.matched() && camera.image.write(out)) ++camera.frames;
}

void LowLevel::publish_truth(const Truth& truth) {
  impl_->publish(truth);
  if (&truth != &impl_->last_truth) impl_->last_truth = truth;
}

}  // namespace wb::dds
