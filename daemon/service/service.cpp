#include "daemon/service/service.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <deque>
#include <thread>

#include "daemon/service/command_counts.hpp"
#include "daemon/service/dds.hpp"
#include "daemon/service/publisher.hpp"

namespace wb {
namespace {

// A command that was handed on, and what its client was told last.
struct Accepted {
  std::uint64_t id = 0;  // Request::id
  std::uint64_t request_id = 0;
  std::string client;
  RequestStatus told;
  bool answered = false;
};

// Enough that a duplicate within the stamps' two seconds is always recognised: an operator is not
// faster.
constexpr std::size_t kRememberedCommands = 256;
// Progress of a running request is told at most this often; changes of outcome or phase always.
constexpr TimeNs kProgressPeriodNs = 100'000'000;

OperatorCommand from_wire(const dds::msg::Command& message) {
  OperatorCommand command;
  command.request_id = message.request_id_;
  command.client = message.client_;
  command.stamp_ns = message.stamp_ns_;
  command.verb = message.verb_;
  command.object = message.object_;
  command.opened_fraction = message.opened_fraction_;
  command.values.assign(message.values_._buffer, message.values_._buffer + message.values_._length);
  return command;
}

std::int64_t beat_period_ns(const ServiceOptions& options) {
  for (const int every :
       {options.state_every, options.status_every, options.plan_every, options.truth_every,
        options.explanation_every, options.diagnostics_every}) {
    if (every < 1) throw config::ConfigError("service: a stream goes out on every beat or rarer");
  }
  if (!(options.rate_hz >= 1 && options.rate_hz <= 1000)) {
    throw config::ConfigError("service: rate_hz = " + std::to_string(options.rate_hz) +
                              " is outside 1 .. 1000");
  }
  return std::llround(1e9 / options.rate_hz);
}

}  // namespace

struct Service::Impl {
  Impl(ServiceOptions given_options, ServicePorts given_ports)
      : options(std::move(given_options)),
        ports(std::move(given_ports)),
        period_ns(beat_period_ns(options)),
        participant(dds::make_participant(options.domain, options.participant)),
        publisher(participant, options, ros_now_ns() - ports.clock()),
        commands(participant, dds::kCommandTopic, dds::kCommandProfile),
        waitset(participant) {
    waitset.attach(commands.condition());
    thread = std::thread([this] { run(); });
  }

  ~Impl() {
    stopping = true;
    thread.join();
  }

  void run() {
    using Clock = std::chrono::steady_clock;
    const std::chrono::nanoseconds period(period_ns);
    Clock::time_point next = Clock::now();
    for (std::uint64_t beat = 0; !stopping;) {
      commands.take([this](const dds::msg::Command& message) { handle(from_wire(message)); });
      RequestStatus status;
      while (ports.take_status(status)) answer(status);
      if (Clock::now() >= next) {
        if (const ServiceSnapshot* newest = ports.newest()) {
          publisher.publish(beat, *newest, counts);
          if (beat % static_cast<std::uint64_t>(options.explanation_every) == 0 &&
              ports.explain(explanation)) {
            publisher.explain(explanation);
          }
        }
        ++beat;
        next = std::max(next + period, Clock::now());  // beats that were missed are not made up
      }
      waitset.wait(std::chrono::nanoseconds(next - Clock::now()).count());
    }
  }

  void handle(const OperatorCommand& command) {
    CheckedCommand checked = check_command(command, options.rules, ros_now_ns());
    const TimeNs now_ns = ports.clock();
    if (checked.refusal == Refusal::kNone && is_duplicate(command)) {
      checked.refusal = Refusal::kDuplicate;
      checked.reason = kDuplicateReason;
    }
    if (checked.refusal == Refusal::kNone) {
      checked.request.id = next_id;
      checked.request.t_ns = now_ns;
      if (ports.submit(checked.request)) {
        accepted.push_back({next_id++, command.request_id, command.client, {}, false});
        if (accepted.size() > kRememberedCommands) accepted.pop_front();
      } else {
        checked.refusal = Refusal::kBusy;
        checked.reason = "the controller's queue of requests is full";
      }
    }
    counts.count(checked.refusal);
    if (checked.refusal != Refusal::kNone) {
      publisher.acknowledge(command.request_id, command.client, now_ns, RequestStatus{},
                            checked.reason);
    }
  }

  bool is_duplicate(const OperatorCommand& command) const {
    return std::any_of(accepted.begin(), accepted.end(), [&](const Accepted& a) {
      return a.request_id == command.request_id && a.client == command.client;
    });
  }

  void answer(const RequestStatus& status) {
    // Requests that did not come over DDS have no client to answer.
    const auto request = std::find_if(accepted.begin(), accepted.end(),
                                      [&](const Accepted& a) { return a.id == status.id; });
    if (request == accepted.end()) return;
    const RequestStatus& told = request->told;
    if (request->answered && told.outcome == status.outcome && told.phase == status.phase &&
        status.t_ns - told.t_ns < kProgressPeriodNs) {
      return;
    }
    request->told = status;
    request->answered = true;
    publisher.acknowledge(request->request_id, request->client, status.t_ns, status,
                          status.reason.view());
  }

  const ServiceOptions options;
  const ServicePorts ports;
  const std::int64_t period_ns;
  CommandCounts counts;
  dds::Entity participant;
  Publisher publisher;
  dds::Reader<dds::msg::Command> commands;
  dds::Waitset waitset;
  DaemonExplanation explanation;
  std::deque<Accepted> accepted;  // oldest first
  std::uint64_t next_id = 1;
  std::atomic<bool> stopping{false};
  std::thread thread;
};

Service::Service(ServiceOptions options, ServicePorts ports)
    : impl_(std::make_unique<Impl>(std::move(options), std::move(ports))) {}
Service::~Service() = default;

std::uint64_t Service::accepted() const { return impl_->counts.of(Refusal::kNone); }
std::uint64_t Service::refused(Refusal kind) const { return impl_->counts.of(kind); }

}  // namespace wb
