// Turns a ServiceSnapshot into the outgoing topics. Internal to the service: DDS types.
// World: the service's thread. Frames on the wire: odom = W, base = B; stamps are ROS time.
#pragma once
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "daemon/service/command_counts.hpp"
#include "daemon/service/dds.hpp"
#include "daemon/service/service.hpp"

namespace wb {

class Publisher {
 public:
  // `ros_offset_ns` is ROS time minus the daemon's clock. Throws config::ConfigError.
  Publisher(const dds::Entity& participant, const ServiceOptions& options,
            std::int64_t ros_offset_ns);

  // Writes what is due on this beat. Streams of the robot's state go out only when the state is a
  // new one.
  void publish(std::uint64_t beat, const ServiceSnapshot& snapshot, const CommandCounts& counts);

  // `explanation`'s stamp is the daemon's clock.
  void explain(const DaemonExplanation& explanation);

  // Acknowledges to a client; `stamp_ns` is the daemon's clock.
  void acknowledge(std::uint64_t request_id, const std::string& client, TimeNs stamp_ns,
                   const RequestStatus& status, std::string_view reason);

 private:
  dds::msg::Time ros_time(TimeNs t_ns) const;
  dds::msg::Header header(TimeNs t_ns) const;
  void publish_joints(const RobotState& state);
  void publish_base(const RobotState& state);
  void publish_plan(const ServiceSnapshot& snapshot);
  void publish_status(const ServiceSnapshot& snapshot);
  void publish_diagnostics(const ServiceSnapshot& snapshot, const CommandCounts& counts);
  void publish_tuning(const ServiceSnapshot& snapshot);
  void publish_truth(const ServiceSnapshot& snapshot);

  const ServiceOptions options_;
  const std::int64_t ros_offset_ns_;
  TimeNs state_t_ns_ = -1;  // of the state that went out last

  dds::Writer<dds::msg::JointState> joints_;
  dds::Writer<dds::msg::Odometry> odometry_;
  dds::Writer<dds::msg::TFMessage> transforms_;
  dds::Writer<dds::msg::Path> plan_;
  dds::Writer<dds::msg::DiagnosticArray> diagnostics_;
  dds::Writer<dds::msg::Status> status_;
  dds::Writer<dds::msg::CommandAck> acknowledgement_;
  dds::Writer<dds::msg::Explanation> explanation_;
  dds::Writer<dds::msg::Tuning> tuning_;
  std::optional<std::uint64_t> tuning_revision_;  // that went out last
  std::map<std::string, dds::Writer<dds::msg::Float64>, std::less<>> truth_joints_;
  std::optional<dds::Writer<dds::msg::DiagnosticArray>> truth_contacts_;  // only with --truth

  std::vector<char*> joint_names_;  // views of options_' names: joints, then fingers
};

}  // namespace wb
