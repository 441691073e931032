#include "drivers/plant/can_side.hpp"

#include <stdexcept>

namespace wb::plant {

// What a node turns: a joint of the robot. The plant's clock is not the bus's: the servo's target
// waits for the next physics step.
class CanSide::Joint final : public can::DriveModel {
 public:
  Joint(SimulatedRobot& robot, int joint) : robot_(robot), joint_(joint) {}
  double position() const noexcept override { return robot_.position(joint_); }
  double velocity() const noexcept override { return robot_.velocity(joint_); }
  double torque() const noexcept override {
    return robot_.driver()->plant.readings().joints[joint_].effort;
  }
  void apply(can::DriveAction action, double target) noexcept override {
    JointTarget t;
    switch (action) {
      case can::DriveAction::kFree:
        t.kind = JointTarget::Kind::kTorque;
        break;
      case can::DriveAction::kBrake:
        break;
      case can::DriveAction::kPosition:
        t.kind = JointTarget::Kind::kPosition;
        t.position = target;
        break;
      case can::DriveAction::kVelocity:
        t.kind = JointTarget::Kind::kVelocity;
        t.velocity = target;
        break;
      case can::DriveAction::kTorque:
        t.kind = JointTarget::Kind::kTorque;
        t.torque = target;
        break;
    }
    robot_.set(joint_, t);
  }

 private:
  SimulatedRobot& robot_;
  int joint_;
};

CanSide::CanSide(SimulatedRobot& robot, const can::PluginConfig& config) : robot_(robot) {
  for (const can::BusConfig& bus : config.buses) {
    if (bus.type != can::BusConfig::Type::kUnix)
      throw std::runtime_error("bus " + bus.name +
                               ": wb-plant serves buses of type unix only (SocketCAN: "
                               "docs/how-to/vm.md)");
    can::BusOptions options;
    options.bit_rate = bus.bit_rate;
    buses_.push_back(std::make_unique<can::SocketBus>(bus.path, bus.paced, options));
  }
  for (const can::DriveConfig& drive : config.drives) {
    const int joint = robot.joint(drive.joint);
    if (joint < 0) throw std::runtime_error("the simulated robot has no joint " + drive.joint);
    joints_.push_back(std::make_unique<Joint>(robot, joint));
    can::NodeOptions node;
    node.node_id = drive.node_id;
    node.scale = drive.scale;
    node.velocity_max = drive.velocity_max;
    node.name = drive.joint;
    if (drive.device_type != 0) node.device_type = drive.device_type;
    if (drive.vendor != 0) node.vendor = drive.vendor;
    if (drive.product != 0) node.product = drive.product;
    if (drive.revision != 0) node.revision = drive.revision;
    if (drive.serial != 0) node.serial = drive.serial;
    nodes_.push_back(
        std::make_unique<can::Cia402Node>(node, buses_[drive.bus]->bus(), *joints_.back()));
  }
}

CanSide::~CanSide() = default;

void CanSide::serve(int timeout_ms) {
  // Asking also lets a master in, on each bus; a tick begins on all of them.
  std::optional<can::Tick> tick;
  bool all = true;
  for (auto& bus : buses_) {
    tick = bus->requested_tick(timeout_ms);
    all = all && tick.has_value();
  }
  if (!all) return;
  // Frames of a period first, then the physics of that period with the targets they brought.
  const TimeNs step = robot_.driver()->plant.step_ns();
  for (TimeNs t = robot_.now(); t < tick->bus_ns;) {
    t = std::min(t + step, tick->bus_ns);
    for (auto& bus : buses_) bus->bus().advance(t);
    robot_.advance(t);
  }
  for (auto& bus : buses_) bus->finish_tick();
}

void CanSide::run_to(TimeNs monotonic_ns, TimeNs plant_ns) {
  for (auto& bus : buses_) bus->pump(monotonic_ns);
  robot_.advance(plant_ns);
}

int CanSide::drives_enabled() const {
  int n = 0;
  for (const auto& node : nodes_) n += node->enabled();
  return n;
}

}  // namespace wb::plant
