// A robot with two joints by another DDS vendor: `fastdds_peer DOMAIN SECONDS`. Describes itself,
// publishes measurements at 200 Hz, grants the lease to whoever asks first, lets its joints run at
// the velocities that it is commanded and stops them when valid_for has passed; besides, it counts
// the daemon's joint_states and status. Ends, at SIGTERM or before, with one line of what it saw.
// Written from docs/how-to/dds.md and the IDL alone; no code of the project.
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <string>
#include <thread>

#include "JointCommandsPubSubTypes.h"
#include "JointMeasurementsPubSubTypes.h"
#include "JointStatePubSubTypes.h"
#include "LeaseGrantPubSubTypes.h"
#include "LeaseRequestPubSubTypes.h"
#include "RobotDescriptionPubSubTypes.h"
#include "StatusPubSubTypes.h"

namespace {

using namespace eprosima::fastdds::dds;
using namespace wholebody_msgs::msg::dds_;
using Clock = std::chrono::steady_clock;

std::int64_t ros_now() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

class Peer {
 public:
  explicit Peer(int domain) {
    // Loopback only, peers by their ports, as config/cyclonedds_loopback.xml has it.
    DomainParticipantQos qos;
    qos.transport().use_builtin_transports = false;
    auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.emplace_back("127.0.0.1");
    qos.transport().user_transports.push_back(udp);
    for (int i = 0; i < 31; ++i) {
      eprosima::fastrtps::rtps::Locator_t peer;
      eprosima::fastrtps::rtps::IPLocator::setIPv4(peer, "127.0.0.1");
      peer.port = static_cast<std::uint32_t>(7400 + 250 * domain + 10 + 2 * i);
      qos.wire_protocol().builtin.initialPeersList.push_back(peer);
    }
    participant_ = DomainParticipantFactory::get_instance()->create_participant(
        static_cast<DomainId_t>(domain), qos);
    if (participant_ == nullptr) throw std::runtime_error("no participant");
    publisher_ = participant_->create_publisher(PUBLISHER_QOS_DEFAULT);
    subscriber_ = participant_->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  }
  ~Peer() {
    participant_->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;

  template <class Type>
  DataWriter* writer(const char* name, bool latched) {
    DataWriterQos qos;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.history().depth = latched ? 1 : 16;
    qos.durability().kind = latched ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    return publisher_->create_datawriter(topic<Type>(name), qos);
  }
  template <class Type>
  DataReader* reader(const char* name, bool reliable) {
    DataReaderQos qos;
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.history().depth = 16;
    return subscriber_->create_datareader(topic<Type>(name), qos);
  }

 private:
  template <class Type>
  Topic* topic(const char* name) {
    TypeSupport type(new Type());
    type.register_type(participant_);
    return participant_->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
  }

  DomainParticipant* participant_ = nullptr;
  Publisher* publisher_ = nullptr;
  Subscriber* subscriber_ = nullptr;
};

template <class Message, class Handle>
void take(DataReader* reader, Handle&& handle) {
  Message message;
  SampleInfo info;
  while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
    if (info.valid_data) handle(message);
  }
}

constexpr int kJoints = 2;
volatile std::sig_atomic_t stopping = 0;

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: fastdds_peer DOMAIN SECONDS\n");
    return 2;
  }
  Peer peer(std::atoi(argv[1]));
  const auto end = Clock::now() + std::chrono::duration<double>(std::atof(argv[2]));

  DataWriter* descriptions =
      peer.writer<RobotDescription_PubSubType>("rt/robot/robot_description", true);
  DataWriter* measurements =
      peer.writer<JointMeasurements_PubSubType>("rt/robot/joint_measurements", false);
  DataWriter* grants = peer.writer<LeaseGrant_PubSubType>("rt/robot/lease_grant", false);
  DataReader* requests = peer.reader<LeaseRequest_PubSubType>("rt/robot/lease_request", true);
  DataReader* commands = peer.reader<JointCommands_PubSubType>("rt/robot/joint_commands", false);
  DataReader* joint_states =
      peer.reader<sensor_msgs::msg::dds_::JointState_PubSubType>("rt/joint_states", false);
  DataReader* statuses = peer.reader<Status_PubSubType>("rt/wholebody/status", false);

  constexpr std::uint64_t kBoot = 0xfa57dd5;
  RobotDescription_ description;
  description.boot_(kBoot);
  description.name_("fast");
  for (int i = 0; i < kJoints; ++i) {
    JointInfo_ joint;
    joint.name_("joint_" + std::to_string(i));
    joint.position_min_(-2);
    joint.position_max_(2);
    joint.velocity_max_(1.5);
    joint.effort_max_(20);
    joint.command_kinds_(1u << 2);  // velocity
    joint.timeout_actions_(7);
    description.joints_().push_back(joint);
  }
  descriptions->write(&description);

  std::uint64_t claim = 0, sequence = 0, accepted = 0, applied = 0, stops = 0, granted = 0;
  std::uint64_t states_seen = 0, status_seen = 0;
  bool both_seen = false;
  std::string first_joint, mode;
  double velocity[kJoints] = {}, position[kJoints] = {};
  bool moving = false, stopped = false;
  Clock::time_point valid_until{}, last = Clock::now();
  constexpr std::uint64_t kLease = 77;
  std::signal(SIGTERM, [](int) { stopping = 1; });
  while (!stopping && Clock::now() < end) {
    take<LeaseRequest_>(requests, [&](const LeaseRequest_& request) {
      LeaseGrant_ grant;
      grant.claim_(request.claim_());
      grant.silence_ns_(1'000'000'000);
      if (request.release_()) {
        if (request.claim_() == claim) claim = 0;
        moving = false;
        grant.reason_("released");
      } else if (claim == 0 || claim == request.claim_()) {
        if (claim == 0) {
          ++granted;
          accepted = 0;
          stopped = false;
        }
        claim = request.claim_();
        grant.lease_(kLease);
      } else {
        grant.reason_("held by somebody");
      }
      grants->write(&grant);
    });
    take<JointCommands_>(commands, [&](const JointCommands_& command) {
      if (claim == 0 || command.lease_() != kLease || command.sequence_() <= accepted || stopped)
        return;
      accepted = command.sequence_();
      if (command.stop_()) {
        moving = false;
        stopped = true;
        ++stops;
        return;
      }
      ++applied;
      moving = true;
      valid_until = Clock::now() + std::chrono::nanoseconds(command.valid_for_ns_());
      for (int i = 0; i < kJoints; ++i)
        velocity[i] = command.kind_()[i] == 2 ? std::clamp(command.velocity_()[i], -1.5, 1.5) : 0;
    });
    take<sensor_msgs::msg::dds_::JointState_>(joint_states, [&](const auto& state) {
      ++states_seen;
      if (!state.name_().empty()) first_joint = state.name_()[0];
    });
    take<Status_>(statuses, [&](const Status_& status) {
      ++status_seen;
      mode = status.mode_().c_str();
    });
    if (!both_seen && states_seen > 0 && status_seen > 0) {
      both_seen = true;
      std::puts("both seen");
      std::fflush(stdout);
    }
    const auto now = Clock::now();
    if (moving && now > valid_until) {
      moving = false;
      stopped = true;
      ++stops;
    }
    const double dt = std::chrono::duration<double>(now - last).count();
    last = now;
    JointMeasurements_ m;
    m.boot_(kBoot);
    m.sequence_(++sequence);
    m.stamp_ns_(ros_now());
    m.joint_count_(kJoints);
    for (int i = 0; i < kJoints; ++i) {
      if (moving) position[i] += velocity[i] * dt;
      m.valid_()[i] = true;
      m.status_()[i] = stopped ? 3 : moving ? 2 : 1;
      m.position_()[i] = position[i];
      m.velocity_()[i] = moving ? velocity[i] : 0;
    }
    m.stopped_(stopped);
    m.lease_(claim != 0 ? kLease : 0);
    m.command_sequence_(accepted);
    measurements->write(&m);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  std::printf(
      "{\"granted\": %llu, \"applied\": %llu, \"stops\": %llu, \"joint_states\": %llu, "
      "\"first_joint\": \"%s\", \"status\": %llu, \"mode\": \"%s\"}\n",
      static_cast<unsigned long long>(granted), static_cast<unsigned long long>(applied),
      static_cast<unsigned long long>(stops), static_cast<unsigned long long>(states_seen),
      first_joint.c_str(), static_cast<unsigned long long>(status_seen), mode.c_str());
  return 0;
}
