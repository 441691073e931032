#include "drivers/dds/link.hpp"

#include <algorithm>
#include <random>

#include "drivers/dds/link_dds.hpp"

namespace wb::dds {
namespace {

constexpr TimeNs kWatchNs = 2'000'000;      // how often the time-out is looked at
constexpr TimeNs kRestNs = 20'000'000;      // between looks when nothing moves
constexpr TimeNs kAskAgainNs = 50'000'000;  // for a lease that was not answered
constexpr TimeNs kClaimTimeoutNs = 2 * kNanosPerSecond;
constexpr TimeNs kReleaseTimeoutNs = 500'000'000;

TimeNs monotonic() { return clock_ns(CLOCK_MONOTONIC); }

}  // namespace

Link::~Link() {
  deactivate();
  stopping_ = true;
  exchange_.to_thread.ring();
  setup_->thread.join();
}

TimeNs Link::stamp_now() const { return exchange_.now() + exchange_.stamp_offset(); }
Arrival Link::arrival(TimeNs memory_ns) const { return {stamp_now(), memory_ns}; }

std::string Link::activate(TimeNs command_timeout_ns, const wb_timeout_action* actions) {
  static std::atomic<std::uint64_t> activations{0};
  exchange_.timeout_ns = command_timeout_ns;
  exchange_.last_write_ns = -1;
  if (config_.commands()) {
    std::unique_lock lock(setup_->mutex);
    for (std::uint32_t j = 0; j < robot_joint_count_; ++j) {
      actions_[j] = 0;  // of joints that are not ours: the first that they have
      while (actions_[j] < WB_TIMEOUT_BRAKE && !(timeout_actions_[j] & (1u << actions_[j])))
        ++actions_[j];
    }
    for (std::size_t i = 0; i < joints_.size(); ++i)
      actions_[joints_[i]] = static_cast<std::uint8_t>(actions[i]);
    setup_->kind = Setup::Kind::kClaim;
    setup_->deadline_ns = monotonic() + kClaimTimeoutNs;
    setup_->result.clear();
    std::random_device random;
    claim_ = (std::uint64_t{random()} << 32) | random() | 1;
    lease_ = 0;
    next_keep_ns_ = 0;
    exchange_.to_thread.ring();
    setup_->done.wait(lock, [&] { return setup_->kind == Setup::Kind::kNone; });
    if (!setup_->result.empty()) return setup_->result;
  }
  exchange_.latched = false;
  exchange_.activation = ++activations;
  return "";
}

void Link::deactivate() {
  exchange_.activation = 0;
  if (!config_.commands()) return;
  std::unique_lock lock(setup_->mutex);
  setup_->kind = Setup::Kind::kRelease;
  setup_->deadline_ns = monotonic() + kReleaseTimeoutNs;
  next_keep_ns_ = 0;
  exchange_.to_thread.ring();
  setup_->done.wait(lock, [&] { return setup_->kind == Setup::Kind::kNone; });
}

void Link::run() noexcept {
  while (!stopping_) {
    const bool moves = exchange_.activation != 0 && !exchange_.paced;
    exchange_.to_thread.wait(moves ? kWatchNs : kRestNs);
    // Read before the commands: a tick follows what was written before it.
    const std::uint64_t asked = exchange_.tick_asked.load(std::memory_order_acquire);
    if (!exchange_.paced) exchange_.watch();
    const std::lock_guard lock(setup_->mutex);
    serve_setup();
    take_all();
    keep_lease();
    send_commands();
    if (asked > tick_sent_) {
      send_tick(asked);
      tick_sent_ = asked;
    }
    finish_tick();
  }
}

// --- in

void Link::take_all() {
  Dds& d = *dds_;
  if (d.description) d.description->take([&](const auto& robot) { adopt(robot); });
  if (d.measurements) take_measurements();
  if (d.imu) {
    d.imu->take([&](const msg::Imu& m) {
      const Fault fault =
          convert(m, arrival(config_.sample_memory_ns), imu_gate_, exchange_.imu.writing());
      if (counters_.count(Stream::kSamples, fault) == Fault::kNone) exchange_.imu.publish();
    });
  }
  if (d.wrench) {
    d.wrench->take([&](const msg::WrenchStamped& m) {
      const Fault fault =
          convert(m, arrival(config_.sample_memory_ns), wrench_gate_, exchange_.wrench.writing());
      if (counters_.count(Stream::kSamples, fault) == Fault::kNone) exchange_.wrench.publish();
    });
  }
  if (d.truth) {
    d.truth->take([&](const msg::Truth& m) { counters_.count(Stream::kSamples, truth_.store(m)); });
  }
  take_frames();
  if (d.grants) take_grants();
}

void Link::take_measurements() {
  dds_->measurements->take([&](const msg::JointMeasurements& m) {
    Sample& sample = exchange_.measurements.writing();
    const Fault fault =
        gate_.convert(m, arrival(exchange_.paced ? 0 : config_.sample_memory_ns), sample);
    if (counters_.count(Stream::kSamples, fault) != Fault::kNone) return;
    exchange_.measurements.publish();
    if (lease_ != 0) {
      if (m.lease_ == lease_) {
        lease_seen_ = true;
        if (m.stopped_) exchange_.latched = true;
      } else if (lease_seen_) {
        lose_lease();
      }
    }
    answered_tick_ = m.tick_;
    truth_wanted_ = m.truth_sequence_;
    std::copy_n(m.frames_, frames_wanted_.size(), frames_wanted_.begin());
  });
}

void Link::take_frames() {
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    Dds::Camera& d = dds_->cameras[i];
    d.info->take([&](const msg::CameraInfo& info) {
      CameraModel model;
      Fault fault = read_camera_info(info, model);
      if (fault == Fault::kNone && !same(model, cameras_[i].model)) fault = Fault::kUncalibrated;
      cameras_[i].calibrated = counters_.count(Stream::kFrames, fault) == Fault::kNone;
    });
    if (d.image) d.image->take([&](const msg::Image& m) { take_frame(i, m); });
    if (d.points) d.points->take([&](const msg::PointCloud2& m) { take_frame(i, m); });
  }
}

template <class Message>
void Link::take_frame(std::size_t index, const Message& message) {
  Camera& camera = cameras_[index];
  ++camera.received;
  const auto refuse = [&](Fault fault) { counters_.count(Stream::kFrames, fault); };
  if (!camera.calibrated) return refuse(Fault::kUncalibrated);
  if (message.header_.frame_id_ == nullptr ||
      config_.cameras[index].frame != message.header_.frame_id_)
    return refuse(Fault::kWrongSource);
  const TimeNs stamp = from_message(message.header_.stamp_);
  const Fault order = camera.gate.check(stamp, arrival(config_.frame_memory_ns));
  if (order != Fault::kNone) return refuse(order);
  bool lost = false;
  float* depth = camera.ring->begin(lost);
  if (lost || depth == nullptr) counters_.frame_lost();
  if (depth == nullptr) return;
  const Fault fault = convert(message, camera.model, depth);
  if (fault == Fault::kNone) {
    camera.ring->end(stamp - exchange_.stamp_offset());
  } else {
    camera.ring->abandon();
    refuse(fault);
  }
}

// --- the lease

void Link::take_grants() {
  dds_->grants->take([&](const msg::LeaseGrant& grant) {
    if (grant.claim_ != claim_ || claim_ == 0) return;  // somebody else's
    if (setup_->kind == Setup::Kind::kRelease) {
      if (grant.lease_ != 0) return;  // an older answer
      claim_ = 0;
      setup_->kind = Setup::Kind::kNone;
      setup_->done.notify_all();
    } else if (setup_->kind == Setup::Kind::kClaim) {
      if (grant.lease_ == 0) {
        setup_->result = std::string("the lease was refused: ") + grant.reason_;
        claim_ = 0;
      }
      lease_ = grant.lease_;
      lease_silence_ns_ = std::clamp<TimeNs>(grant.silence_ns_, 4'000'000, kNanosPerSecond);
      lease_seen_ = stop_sent_ = false;
      sequence_ = 0;
      next_keep_ns_ = monotonic() + lease_silence_ns_ / 4;
      setup_->kind = Setup::Kind::kNone;
      setup_->done.notify_all();
    } else if (lease_ != 0 && grant.lease_ != lease_) {
      lose_lease();
    }
  });
}

void Link::lose_lease() {
  counters_.lease_lost();
  lease_ = claim_ = 0;
  exchange_.latched = true;
}

void Link::serve_setup() {
  if (setup_->kind == Setup::Kind::kNone) return;
  const bool release = setup_->kind == Setup::Kind::kRelease;
  if (release) lease_ = 0;
  if (monotonic() > setup_->deadline_ns || (release && claim_ == 0)) {
    if (!release) setup_->result = "the low-level computer does not answer the lease request";
    claim_ = 0;
    setup_->kind = Setup::Kind::kNone;
    setup_->done.notify_all();
  }
}

// Repeats the request: while it is not answered, and as a sign of life.
void Link::keep_lease() {
  if (claim_ == 0 || monotonic() < next_keep_ns_) return;
  const bool asking = setup_->kind != Setup::Kind::kNone;
  msg::LeaseRequest out{};
  copy_text(out.holder_, dds_->holder);
  out.claim_ = claim_;
  out.stamp_ns_ = clock_ns(CLOCK_REALTIME);
  out.release_ = setup_->kind == Setup::Kind::kRelease;
  out.joint_count_ = joints_.empty() ? 0 : robot_joint_count_;
  std::copy_n(actions_.begin(), out.joint_count_, out.timeout_action_);
  dds_->lease_requests->write(out);
  next_keep_ns_ = monotonic() + (asking ? kAskAgainNs : lease_silence_ns_ / 4);
  stop_sent_ = false;  // said again, too
}

// --- out

void Link::send_commands() {
  if (lease_ == 0) return;
  const std::uint64_t activation = exchange_.activation.load(std::memory_order_acquire);
  const Order* order = exchange_.orders.read();
  const bool latched = exchange_.latched.load(std::memory_order_acquire);
  const bool is_new =
      order && order->seq != sent_order_ && order->activation == activation && activation != 0;
  if (latched ? stop_sent_ || activation == 0 : !is_new) return;
  msg::JointCommands out{};
  out.lease_ = lease_;
  out.sequence_ = ++sequence_;
  out.valid_for_ns_ = exchange_.timeout_ns;
  out.stop_ = latched;
  if (latched) {
    out.stamp_ns_ = stamp_now();
    stop_sent_ = true;
  } else {
    const wb_commands& c = order->commands;
    out.stamp_ns_ = c.t_ns + exchange_.stamp_offset();
    out.joint_count_ = joints_.empty() ? 0 : robot_joint_count_;
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const std::uint32_t j = joints_[i];
      const auto& joint = c.joints[i];
      out.kind_[j] = static_cast<std::uint8_t>(joint.kind);
      out.position_[j] = joint.position;
      out.velocity_[j] = joint.velocity;
      out.effort_[j] = joint.effort;
      out.stiffness_[j] = joint.stiffness;
      out.damping_[j] = joint.damping;
    }
    out.has_gripper_ = config_.gripper;
    out.gripper_opening_ = c.gripper.opening;
    out.gripper_force_ = c.gripper.force;
    sent_order_ = order->seq;
  }
  if (!dds_->commands->write(out)) counters_.command_unsent();
}

void Link::send_tick(std::uint64_t number) {
  // What the last tick still owes is given up.
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    if (announced_[i] >= 0)
      cameras_[i].received = std::max(cameras_[i].received, frames_wanted_[announced_[i]]);
  }
  truth_given_up_ = truth_wanted_;
  dds_->ticks->write(
      {session_, number, exchange_.tick_t_ns.load(), lease_, lease_ != 0 ? sequence_ : 0});
}

void Link::finish_tick() {
  if (!exchange_.paced || answered_tick_ != tick_sent_ || exchange_.tick_done == tick_sent_) return;
  if (config_.truth && truth_wanted_ > truth_given_up_ && truth_.sequence() < truth_wanted_) return;
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    if (announced_[i] >= 0 && cameras_[i].received < frames_wanted_[announced_[i]]) return;
  }
  exchange_.tick_done.store(tick_sent_, std::memory_order_release);
  exchange_.to_control.ring();
}

}  // namespace wb::dds
