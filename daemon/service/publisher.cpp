#include "daemon/service/publisher.hpp"

#include <deque>

namespace wb {
namespace {

constexpr const char* kOdomFrame = "odom";
constexpr const char* kBaseFrame = "base";
constexpr std::size_t kMaxNames = kMaxJoints + 8;  // joints and fingers

dds::msg::RosPose ros_pose(const Pose& pose) {
  return {{pose.p[0], pose.p[1], pose.p[2]}, {pose.q[0], pose.q[1], pose.q[2], pose.q[3]}};
}

Pose base_pose(const RobotState& state) { return Pose::from(state.X_WB()); }

// Builds a DiagnosticArray whose texts live in the builder.
class Diagnostics {
 public:
  enum class Level : std::uint8_t { kOk = 0, kWarn = 1, kError = 2 };

  void status(Level level, std::string_view name, std::string_view message) {
    dds::msg::DiagnosticStatus status{};
    status.level_ = static_cast<std::uint8_t>(level);
    status.name_ = keep(name);
    status.message_ = keep(message);
    status.hardware_id_ = keep("wholebody");
    statuses_.push_back(status);
    values_.emplace_back();
  }
  // A value of the status added last.
  void value(std::string_view key, std::string_view text) {
    values_.back().push_back({keep(key), keep(text)});
  }
  void value(std::string_view key, std::uint64_t count) { value(key, std::to_string(count)); }
  void value(std::string_view key, double number) { value(key, std::to_string(number)); }

  bool write(const dds::Writer<dds::msg::DiagnosticArray>& writer, const dds::msg::Header& header) {
    for (std::size_t i = 0; i < statuses_.size(); ++i) {
      dds::view(statuses_[i].values_, values_[i], values_[i].size());
    }
    dds::msg::DiagnosticArray message{};
    message.header_ = header;
    dds::view(message.status_, statuses_, statuses_.size());
    return writer.write(message);
  }

 private:
  char* keep(std::string_view text) { return texts_.emplace_back(text).data(); }

  std::deque<std::string> texts_;  // a deque: its strings never move
  std::vector<dds::msg::DiagnosticStatus> statuses_;
  std::vector<std::vector<dds::msg::KeyValue>> values_;
};

}  // namespace

Publisher::Publisher(const dds::Entity& participant, const ServiceOptions& options,
                     std::int64_t ros_offset_ns)
    : options_(options),
      ros_offset_ns_(ros_offset_ns),
      joints_(participant, "rt/joint_states", dds::kStreamProfile),
      odometry_(participant, "rt/odom", dds::kStreamProfile),
      transforms_(participant, "rt/tf", {true, false, 100}),  // depth of ROS's own tf broadcasters
      plan_(participant, "rt/plan", dds::kStreamProfile),
      diagnostics_(participant, "rt/diagnostics", {true, false, 10}),
      status_(participant, dds::kStatusTopic, dds::kStreamProfile),
      acknowledgement_(participant, dds::kAckTopic, dds::kAckProfile),
      explanation_(participant, dds::kExplanationTopic, dds::kLatchedProfile),
      tuning_(participant, dds::kTuningTopic, dds::kLatchedProfile) {
  for (const auto& name : options_.joint_names) joint_names_.push_back(dds::text(name.c_str()));
  for (const auto& name : options_.finger_names) joint_names_.push_back(dds::text(name.c_str()));
  if (options_.joint_names.size() > kMaxJoints || joint_names_.size() > kMaxNames) {
    throw config::ConfigError("service: too many joints and fingers to publish");
  }
  if (options_.truth) {
    truth_contacts_.emplace(participant, "rt/truth/contacts", dds::kStreamProfile);
    for (const auto& object : options_.rules.objects) {
      truth_joints_.try_emplace(object, participant, "rt/truth/" + object, dds::kStreamProfile);
    }
  }
}

void Publisher::publish(std::uint64_t beat, const ServiceSnapshot& snapshot,
                        const CommandCounts& counts) {
  const auto due = [&](int every) { return beat % static_cast<std::uint64_t>(every) == 0; };
  const RobotState& state = snapshot.state;
  if (due(options_.state_every) && state.seq != 0 && state.t_ns != state_t_ns_) {
    state_t_ns_ = state.t_ns;
    publish_joints(state);
    publish_base(state);
  }
  if (due(options_.plan_every) && snapshot.plan_count > 0) publish_plan(snapshot);
  if (due(options_.status_every)) publish_status(snapshot);
  if (tuning_revision_ != snapshot.weights.revision) publish_tuning(snapshot);
  if (due(options_.diagnostics_every)) publish_diagnostics(snapshot, counts);
  if (due(options_.truth_every) && options_.truth) publish_truth(snapshot);
}

void Publisher::acknowledge(std::uint64_t request_id, const std::string& client, TimeNs stamp_ns,
                            const RequestStatus& status, std::string_view reason) {
  dds::msg::CommandAck message{};
  message.request_id_ = request_id;
  dds::copy_text(message.client_, client);
  message.stamp_ns_ = stamp_ns + ros_offset_ns_;
  dds::copy_text(message.outcome_, to_string(status.outcome));
  dds::copy_text(message.phase_, to_string(status.phase));
  dds::copy_text(message.reason_, reason);
  message.joint_value_ = status.joint_value;
  message.joint_range_ = status.joint_range;
  acknowledgement_.write(message);
}

dds::msg::Time Publisher::ros_time(TimeNs t_ns) const {
  const std::int64_t ros_ns = t_ns + ros_offset_ns_;
  return {static_cast<std::int32_t>(ros_ns / kNanosPerSecond),
          static_cast<std::uint32_t>(ros_ns % kNanosPerSecond)};
}

dds::msg::Header Publisher::header(TimeNs t_ns) const {
  return {ros_time(t_ns), dds::text(kOdomFrame)};
}

void Publisher::publish_joints(const RobotState& state) {
  const std::size_t joints = options_.joint_names.size();
  const std::size_t fingers = options_.finger_names.size();
  if (state.joint_count != static_cast<int>(joints)) return;
  std::array<double, kMaxNames> q{}, dq{}, tau{};
  std::copy_n(state.q.begin(), joints, q.begin());
  std::copy_n(state.dq.begin(), joints, dq.begin());
  std::copy_n(state.tau.begin(), joints, tau.begin());
  for (std::size_t i = 0; i < fingers; ++i) {
    q[joints + i] = state.gripper_opening_m / static_cast<double>(fingers);
    tau[joints + i] = state.gripper_force_n;
  }
  dds::msg::JointState message{};
  message.header_ = header(state.t_ns);
  message.header_.frame_id_ = dds::text("");
  dds::view(message.name_, joint_names_, joint_names_.size());
  dds::view(message.position_, q, joints + fingers);
  dds::view(message.velocity_, dq, joints + fingers);
  dds::view(message.effort_, tau, joints + fingers);
  joints_.write(message);
}

void Publisher::publish_base(const RobotState& state) {
  const dds::msg::RosPose pose = ros_pose(base_pose(state));

  dds::msg::Odometry odometry{};  // covariances zero: unknown
  odometry.header_ = header(state.t_ns);
  odometry.child_frame_id_ = dds::text(kBaseFrame);
  odometry.pose_.pose_ = pose;
  odometry.twist_.twist_.linear_.x_ = state.base_velocity[0];
  odometry.twist_.twist_.linear_.y_ = state.base_velocity[1];
  odometry.twist_.twist_.angular_.z_ = state.base_velocity[2];
  odometry_.write(odometry);

  std::array<dds::msg::TransformStamped, 1> transform{};
  transform[0].header_ = header(state.t_ns);
  transform[0].child_frame_id_ = dds::text(kBaseFrame);
  transform[0].transform_.translation_ = {pose.position_.x_, pose.position_.y_, pose.position_.z_};
  transform[0].transform_.rotation_ = pose.orientation_;
  dds::msg::TFMessage message{};
  dds::view(message.transforms_, transform, transform.size());
  transforms_.write(message);
}

void Publisher::publish_plan(const ServiceSnapshot& snapshot) {
  std::array<dds::msg::PoseStamped, kMaxNodes> poses{};
  const std::size_t count = std::min<std::size_t>(snapshot.plan_count, poses.size());
  for (std::size_t i = 0; i < count; ++i) {
    poses[i] = {header(snapshot.plan_t_ns[i]), ros_pose(snapshot.plan[i])};
  }
  dds::msg::Path message{};
  message.header_ = header(snapshot.plan_t_ns[0]);
  dds::view(message.poses_, poses, count);
  plan_.write(message);
}

void Publisher::publish_status(const ServiceSnapshot& snapshot) {
  const RobotState& state = snapshot.state;
  dds::msg::Status message{};
  message.stamp_ = ros_time(state.t_ns);
  dds::copy_text(message.mode_, to_string(state.mode));
  dds::copy_text(message.phase_, to_string(state.phase));
  dds::copy_text(message.object_, snapshot.object.view());
  if (snapshot.request.id != 0) {
    dds::copy_text(message.outcome_, to_string(snapshot.request.outcome));
    dds::copy_text(message.reason_, snapshot.request.reason.view());
  }
  message.joint_value_ = snapshot.request.joint_value;
  message.joint_range_ = snapshot.request.joint_range;
  std::copy(state.base.begin(), state.base.end(), message.base_);
  message.gripper_opening_m_ = state.gripper_opening_m;

  std::array<dds::msg::LoopTiming, ServiceSnapshot::kMaxLoops> loops{};
  const std::size_t loop_count = std::min<std::size_t>(snapshot.loop_count, loops.size());
  for (std::size_t i = 0; i < loop_count; ++i) {
    const LoopStatistics& loop = snapshot.loops[i];
    dds::copy_text(loops[i].name_, loop.name.view());
    loops[i].cycles_ = loop.cycles;
    loops[i].overruns_ = loop.overruns;
    loops[i].p50_us_ = loop.p50_us;
    loops[i].p99_us_ = loop.p99_us;
    loops[i].max_us_ = loop.max_us;
  }
  dds::view(message.loops_, loops, loop_count);

  std::array<dds::msg::Counter, ServiceSnapshot::kMaxCounters> counters{};
  const std::size_t counter_count = std::min<std::size_t>(snapshot.counter_count, counters.size());
  for (std::size_t i = 0; i < counter_count; ++i) {
    dds::copy_text(counters[i].name_, snapshot.counters[i].name.view());
    counters[i].count_ = snapshot.counters[i].count;
  }
  dds::view(message.counters_, counters, counter_count);
  dds::copy_text(message.mpc_trouble_, snapshot.mpc_trouble.data());
  status_.write(message);
}

void Publisher::publish_diagnostics(const ServiceSnapshot& snapshot, const CommandCounts& counts) {
  using Level = Diagnostics::Level;
  const Mode mode = snapshot.state.mode;
  const bool trouble = mode == Mode::kHold || mode == Mode::kSettle;
  Diagnostics diagnostics;
  const Level level = trouble ? Level::kError : mode == Mode::kDegraded ? Level::kWarn : Level::kOk;
  diagnostics.status(level, "wholebody/mode", to_string(mode));
  diagnostics.value("phase", to_string(snapshot.state.phase));
  const int counter_count = std::min(snapshot.counter_count, ServiceSnapshot::kMaxCounters);
  for (int i = 0; i < counter_count; ++i) {
    diagnostics.value(snapshot.counters[i].name.view(), snapshot.counters[i].count);
  }
  const int loop_count = std::min(snapshot.loop_count, ServiceSnapshot::kMaxLoops);
  for (int i = 0; i < loop_count; ++i) {
    const LoopStatistics& loop = snapshot.loops[i];
    diagnostics.status(loop.overruns ? Level::kWarn : Level::kOk,
                       "wholebody/loop/" + std::string(loop.name.view()),
                       loop.overruns ? "overruns" : "in time");
    diagnostics.value("cycles", loop.cycles);
    diagnostics.value("overruns", loop.overruns);
    diagnostics.value("p50_us", loop.p50_us);
    diagnostics.value("p99_us", loop.p99_us);
    diagnostics.value("max_us", loop.max_us);
  }
  diagnostics.status(Level::kOk, "wholebody/commands", "");
  diagnostics.value("handed on", counts.of(Refusal::kNone));
  for (int kind = 1; kind < kRefusalKinds; ++kind) {
    const auto refusal = static_cast<Refusal>(kind);
    diagnostics.value("refused: " + std::string(to_string(refusal)), counts.of(refusal));
  }
  diagnostics.write(diagnostics_, header(snapshot.state.t_ns));
}

void Publisher::publish_tuning(const ServiceSnapshot& snapshot) {
  const auto& infos = options_.rules.weights;
  std::vector<dds::msg::Weight> weights(infos.size());
  for (std::size_t i = 0; i < infos.size(); ++i) {
    dds::copy_text(weights[i].name_, infos[i].name);
    const bool tuned = snapshot.weights.count == static_cast<int>(infos.size());
    weights[i].value_ = tuned ? snapshot.weights.values[i] : infos[i].configured;
    weights[i].configured_ = infos[i].configured;
    weights[i].low_ = infos[i].low;
    weights[i].high_ = infos[i].high;
  }
  dds::msg::Tuning message{};
  message.revision_ = snapshot.weights.revision;
  dds::view(message.weights_, weights, weights.size());
  if (tuning_.write(message)) tuning_revision_ = snapshot.weights.revision;
}

void Publisher::explain(const DaemonExplanation& e) {
  std::vector<dds::msg::TermPull> terms(e.terms.size());
  for (std::size_t i = 0; i < terms.size(); ++i) {
    dds::copy_text(terms[i].name_, e.terms[i].name);
    terms[i].cost_ = e.terms[i].cost;
    terms[i].share_ = e.terms[i].share;
    terms[i].violation_ = e.terms[i].violation;
    terms[i].pull_ = e.terms[i].pull;
  }
  constexpr std::size_t kMost = 16;  // of the message
  std::vector<dds::msg::Competition> competing(std::min(kMost, e.competing.size()));
  for (std::size_t i = 0; i < competing.size(); ++i) {
    dds::copy_text(competing[i].first_, e.competing[i].first);
    dds::copy_text(competing[i].second_, e.competing[i].second);
    competing[i].cosine_ = e.competing[i].cosine;
    dds::copy_text(competing[i].text_, e.competing[i].text);
  }
  dds::msg::Explanation message{};
  message.stamp_ = ros_time(e.stamp_ns);
  dds::copy_text(message.status_, e.status);
  dds::copy_text(message.trouble_, e.trouble);
  message.step_ = e.step;
  message.cpu_ms_ = e.cpu_ms;
  message.cost_ = e.cost;
  message.weights_revision_ = e.weights_revision;
  dds::view(message.terms_, terms, std::min(kMost, terms.size()));
  dds::view(message.competing_, competing, competing.size());
  explanation_.write(message);
}

void Publisher::publish_truth(const ServiceSnapshot& snapshot) {
  const int joint_count = std::min(snapshot.truth_joint_count, ServiceSnapshot::kMaxTruth);
  for (int i = 0; i < joint_count; ++i) {
    const auto writer = truth_joints_.find(snapshot.truth_joints[i].object.view());
    if (writer == truth_joints_.end()) continue;
    writer->second.write({snapshot.truth_joints[i].value});
  }
  Diagnostics contacts;
  contacts.status(Diagnostics::Level::kOk, "truth/contacts", "");
  const int contact_count = std::min(snapshot.truth_contact_count, ServiceSnapshot::kMaxTruth);
  for (int i = 0; i < contact_count; ++i) {
    contacts.value(snapshot.truth_contacts[i].body_a.view(),
                   snapshot.truth_contacts[i].body_b.view());
  }
  contacts.write(*truth_contacts_, header(snapshot.state.t_ns));
}

}  // namespace wb
