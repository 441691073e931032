#include "daemon/service/client.hpp"

#include <unistd.h>

#include <array>
#include <chrono>
#include <deque>
#include <random>
#include <sstream>
#include <thread>

#include "daemon/service/dds.hpp"

namespace wb {
namespace {

std::string unique_id(const std::string& name) {
  std::array<char, 33> host{};
  gethostname(host.data(), host.size() - 1);
  std::ostringstream id;
  id << name.substr(0, 8) << '-' << host.data() << '-' << getpid() << '-' << std::hex
     << std::random_device{}();
  return id.str();
}

OperatorAck from_wire(const dds::msg::CommandAck& message) {
  return {message.request_id_, message.client_, message.stamp_ns_,    message.outcome_,
          message.phase_,      message.reason_, message.joint_value_, message.joint_range_};
}

DaemonStatus from_wire(const dds::msg::Status& message) {
  DaemonStatus status;
  status.stamp_ns = message.stamp_.sec_ * kNanosPerSecond + message.stamp_.nanosec_;
  status.mode = message.mode_;
  status.phase = message.phase_;
  status.object = message.object_;
  status.outcome = message.outcome_;
  status.reason = message.reason_;
  status.joint_value = message.joint_value_;
  status.joint_range = message.joint_range_;
  std::copy_n(message.base_, status.base.size(), status.base.begin());
  status.gripper_opening_m = message.gripper_opening_m_;
  for (std::uint32_t i = 0; i < message.loops_._length; ++i) {
    const dds::msg::LoopTiming& loop = message.loops_._buffer[i];
    status.loops.push_back(
        {loop.name_, loop.cycles_, loop.overruns_, loop.p50_us_, loop.p99_us_, loop.max_us_});
  }
  for (std::uint32_t i = 0; i < message.counters_._length; ++i) {
    const dds::msg::Counter& counter = message.counters_._buffer[i];
    status.counters.push_back({counter.name_, counter.count_});
  }
  status.mpc_trouble = message.mpc_trouble_;
  return status;
}

DaemonExplanation from_wire(const dds::msg::Explanation& message) {
  DaemonExplanation e;
  e.stamp_ns = message.stamp_.sec_ * kNanosPerSecond + message.stamp_.nanosec_;
  e.status = message.status_;
  e.trouble = message.trouble_;
  e.step = message.step_;
  e.cpu_ms = message.cpu_ms_;
  e.cost = message.cost_;
  e.weights_revision = message.weights_revision_;
  for (std::uint32_t i = 0; i < message.terms_._length; ++i) {
    const dds::msg::TermPull& t = message.terms_._buffer[i];
    e.terms.push_back({t.name_, t.cost_, t.share_, t.violation_, t.pull_});
  }
  for (std::uint32_t i = 0; i < message.competing_._length; ++i) {
    const dds::msg::Competition& c = message.competing_._buffer[i];
    e.competing.push_back({c.first_, c.second_, c.cosine_, c.text_});
  }
  return e;
}

DaemonTuning from_wire(const dds::msg::Tuning& message) {
  DaemonTuning tuning;
  tuning.revision = message.revision_;
  for (std::uint32_t i = 0; i < message.weights_._length; ++i) {
    const dds::msg::Weight& w = message.weights_._buffer[i];
    tuning.weights.push_back({w.name_, w.value_, w.configured_, w.low_, w.high_});
  }
  return tuning;
}

template <class Value, class Message>
std::optional<Value> take_newest(dds::Reader<Message>& reader) {
  std::optional<Value> newest;
  reader.take([&](const Message& message) { newest = from_wire(message); });
  return newest;
}

using Clock = std::chrono::steady_clock;

// Several times within the two seconds after which a command's stamp is stale.
constexpr std::chrono::milliseconds kResendPeriod{500};

struct Sent {
  OperatorCommand command;
  Clock::time_point at;
  bool answered = false;
  bool repeated = false;
};

}  // namespace

struct Client::Impl {
  Impl(int domain, const std::string& name)
      : id(unique_id(name)),
        participant(dds::make_participant(domain, id)),
        commands(participant, dds::kCommandTopic, dds::kCommandProfile),
        acknowledgements(participant, dds::kAckTopic, dds::kAckProfile),
        status(participant, dds::kStatusTopic, dds::kStreamProfile),
        explanation(participant, dds::kExplanationTopic, dds::kLatchedProfile),
        tuning(participant, dds::kTuningTopic, dds::kLatchedProfile),
        waitset(participant) {
    waitset.attach(acknowledgements.condition());
    waitset.attach(status.condition());
  }

  bool write(const OperatorCommand& command) {
    dds::msg::Command message{};
    message.request_id_ = command.request_id;
    dds::copy_text(message.client_, command.client);
    message.stamp_ns_ = command.stamp_ns;
    dds::copy_text(message.verb_, command.verb);
    dds::copy_text(message.object_, command.object);
    message.opened_fraction_ = command.opened_fraction;
    std::vector<double> values = command.values;
    dds::view(message.values_, values, values.size());
    return commands.write(message);
  }

  void repeat_unanswered() {
    for (Sent& s : sent) {
      if (s.answered || Clock::now() - s.at < kResendPeriod) continue;
      s.at = Clock::now();
      s.repeated = true;
      write(s.command);
    }
  }

  void receive(OperatorAck ack) {
    for (Sent& s : sent) {
      if (s.command.request_id != ack.request_id || s.command.client != ack.client) continue;
      // The first of the two did arrive: its own answer counts.
      if (s.repeated && ack.reason == kDuplicateReason) return;
      s.answered = true;
    }
    received.push_back(std::move(ack));
  }

  const std::string id;
  dds::Entity participant;
  dds::Writer<dds::msg::Command> commands;
  dds::Reader<dds::msg::CommandAck> acknowledgements;
  dds::Reader<dds::msg::Status> status;
  dds::Reader<dds::msg::Explanation> explanation;
  dds::Reader<dds::msg::Tuning> tuning;
  dds::Waitset waitset;
  std::vector<Sent> sent;
  std::deque<OperatorAck> received;
  std::uint64_t next_request = 1;
};

Client::Client(int domain, const std::string& name) : impl_(std::make_unique<Impl>(domain, name)) {}
Client::~Client() = default;

bool Client::wait_for_daemon(double timeout_s) {
  const auto deadline = Clock::now() + std::chrono::duration<double>(timeout_s);
  const auto there = [this] {
    return impl_->commands.matched() && impl_->acknowledgements.matched() &&
           impl_->status.matched();
  };
  while (!there()) {
    if (Clock::now() >= deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

OperatorCommand Client::command(const std::string& verb) {
  OperatorCommand command;
  command.request_id = impl_->next_request++;
  command.client = impl_->id;
  command.stamp_ns = ros_now_ns();
  command.verb = verb;
  return command;
}

bool Client::send(const OperatorCommand& command) {
  impl_->sent.push_back({command, Clock::now()});
  return impl_->write(command);
}

void Client::wait(double timeout_s) {
  impl_->repeat_unanswered();
  if (impl_->received.empty()) impl_->waitset.wait(from_seconds(timeout_s));
}

std::optional<OperatorAck> Client::take_acknowledgement() {
  impl_->acknowledgements.take(
      [this](const dds::msg::CommandAck& message) { impl_->receive(from_wire(message)); });
  if (impl_->received.empty()) return std::nullopt;
  OperatorAck oldest = std::move(impl_->received.front());
  impl_->received.pop_front();
  return oldest;
}

std::optional<DaemonStatus> Client::take_status() {
  return take_newest<DaemonStatus>(impl_->status);
}
std::optional<DaemonExplanation> Client::take_explanation() {
  return take_newest<DaemonExplanation>(impl_->explanation);
}
std::optional<DaemonTuning> Client::take_tuning() {
  return take_newest<DaemonTuning>(impl_->tuning);
}

const std::string& Client::id() const { return impl_->id; }

}  // namespace wb
