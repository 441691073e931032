// What Link keeps from its header: the DDS entities, and the setup world's requests to the thread.
#pragma once
#include <condition_variable>
#include <mutex>
#include <optional>
#include <thread>

#include "drivers/dds/link.hpp"
#include "drivers/dds/messages.hpp"

namespace wb::dds {

struct Link::Dds {
  struct Camera {
    std::optional<Reader<msg::Image>> image;
    std::optional<Reader<msg::PointCloud2>> points;
    std::optional<Reader<msg::CameraInfo>> info;
    bool matched() const { return image ? image->matched() : points->matched(); }
  };

  Entity participant;
  std::optional<Reader<msg::RobotDescription>> description;
  std::optional<Reader<msg::LeaseGrant>> grants;
  std::optional<Writer<msg::LeaseRequest>> lease_requests;
  std::optional<Writer<msg::JointCommands>> commands;
  std::optional<Writer<msg::Tick>> ticks;
  std::optional<Reader<msg::Imu>> imu;
  std::optional<Reader<msg::WrenchStamped>> wrench;
  std::optional<Reader<msg::Truth>> truth;
  std::vector<Camera> cameras;
  std::optional<Reader<msg::JointMeasurements>> measurements;
  std::string holder;  // how the lease names us
};

struct Link::Setup {
  enum class Kind { kNone, kClaim, kRelease };
  std::mutex mutex;
  std::condition_variable done;
  Kind kind = Kind::kNone;
  TimeNs deadline_ns = 0;
  std::string result;  // empty: granted
  std::thread thread;  // Link's
};

// Makes a reader ring the doorbell of the thread.
template <class Message>
void wake_on_data(Reader<Message>& reader, Doorbell& doorbell) {
  reader.on_data([](dds_entity_t, void* bell) { static_cast<Doorbell*>(bell)->ring(); }, &doorbell);
}

}  // namespace wb::dds
