#include "drivers/can/faults/rig.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/can/canopen/objects.hpp"

namespace wb::can {
namespace {

class InProcessPacer final : public Pacer {
 public:
  explicit InProcessPacer(std::vector<std::unique_ptr<InProcessBus>>& buses) : buses_(buses) {}
  TimeNs bus_time() const RT_SAFE override { return buses_.front()->now(); }
  bool advance(const Tick& tick) RT_SAFE override {
    for (auto& bus : buses_) bus->advance(tick.bus_ns);
    return true;
  }

 private:
  std::vector<std::unique_ptr<InProcessBus>>& buses_;
};

constexpr double kAmplitude = 0.4, kFrequency = 2.0;  // rad, rad/s: speeds up to 0.8 rad/s
constexpr double kTorque = 0.5;                       // Nm

}  // namespace

int GatePort::send(const Frame* frames, int count) RT_SAFE {
  const int offered = take_at_most >= 0 && take_at_most < count ? take_at_most : count;
  refused_ += static_cast<std::uint64_t>(count - offered);
  for (int i = 0; i < offered && sent; ++i) sent(frames[i]);
  return port_.send(frames, offered);
}

int GatePort::receive(Frame* frames, int capacity) RT_SAFE {
  int n = 0;
  for (; n < capacity && !inject.empty(); ++n) {
    frames[n] = inject.back();
    inject.pop_back();
  }
  if (n < capacity) n += port_.receive(frames + n, capacity - n);
  for (int i = 0; i < n && got; ++i) got(frames[i]);
  return n;
}

void Sniffer::received(const Frame& frame) noexcept {
  if (frame.id > cob::kRpdo1 && frame.id < cob::kRpdo1 + 0x80 && frame.length >= 2 &&
      controlword::enables(static_cast<std::uint16_t>(get_bytes(frame.data.data(), 2))))
    ++enabling;
  if (frame.id != cob::kSync) return;
  ++syncs;
  if (last_sync_ns >= 0) shortest_sync_ns = std::min(shortest_sync_ns, frame.t_ns - last_sync_ns);
  last_sync_ns = frame.t_ns;
}

Rig::Rig(const RigOptions& options) : options_(options) {
  config_.supervision = options.supervision;
  for (int b = 0; b < options.buses; ++b) {
    BusConfig bus;
    bus.name = "bus" + std::to_string(b);
    bus.paced = true;
    config_.buses.push_back(bus);
    buses.push_back(std::make_unique<InProcessBus>());
    bus_ports.push_back(&buses.back()->attach("master"));
    ports.push_back(std::make_unique<GatePort>(*bus_ports.back()));
    sniffers.push_back(std::make_unique<Sniffer>());
    buses.back()->attach("sniffer", sniffers.back().get());
    for (int i = 0; i < options.drives; ++i) {
      DriveConfig d;
      NodeOptions n;
      const int joint = static_cast<int>(config_.drives.size());
      d.joint = "joint_" + std::to_string(joint);
      d.bus = b;
      d.node_id = n.node_id = i + 1;
      d.mode = options.mode;
      d.position_min = -2;
      d.position_max = 2;
      d.velocity_max = 2;
      d.effort_max = 20;
      d.following_max = options.mode == DriveMode::kCsp ? 0.03 : 0.3;
      d.device_type = n.device_type;
      d.vendor = n.vendor;
      d.product = n.product;
      if (options.adjust) options.adjust(joint, d, n);
      config_.drives.push_back(d);
      models.push_back(std::make_unique<IntegratorModel>(0.1 * i));
      nodes.push_back(std::make_unique<Cia402Node>(n, *buses.back(), *models.back()));
    }
  }
  pacer = std::make_unique<InProcessPacer>(buses);
  make_driver();
}

void Rig::make_driver() {
  std::vector<CanPort*> all;
  for (auto& port : ports) all.push_back(port.get());
  driver = std::make_unique<CanDriver>(config_, all, pacer.get());
}

bool Rig::restart() {
  driver.reset();
  make_driver();
  return driver->configure() == WB_OK;
}

Rig::~Rig() = default;

std::vector<double> Rig::positions() const {
  std::vector<double> q;
  for (const auto& m : models) q.push_back(m->position());
  return q;
}

bool Rig::all_follow() const {
  for (int i = 0; i < joints(); ++i) {
    if (readings.joints[i].status != WB_JOINT_FOLLOWING || !readings.joints[i].valid ||
        !nodes[static_cast<std::size_t>(i)]->enabled())
      return false;
  }
  return true;
}

bool Rig::none_follows() const {
  for (int i = 0; i < joints(); ++i) {
    if (readings.joints[i].status == WB_JOINT_FOLLOWING) return false;
  }
  return true;
}

bool Rig::any_enabled() const {
  return std::any_of(nodes.begin(), nodes.end(), [](const auto& n) { return n->enabled(); });
}

wb_status Rig::activate() {
  const std::vector<wb_timeout_action> actions(static_cast<std::size_t>(joints()), WB_TIMEOUT_HOLD);
  moving_ = false;
  return driver->activate(50'000'000, actions.data());
}

bool Rig::start() {
  if (driver->configure() != WB_OK) return false;
  run(0.05);
  if (activate() != WB_OK) return false;
  run(0.6);
  return all_follow();
}

// Stand still until everybody follows, then move to and fro.
void Rig::compose() {
  if (!moving_) {
    start_.clear();
    for (int i = 0; i < joints(); ++i) start_.push_back(readings.joints[i].position);
    motion_start_ = now_;
    moving_ = all_follow();
  }
  const double t = moving_ ? to_seconds(now_ - motion_start_) : 0;
  commands.t_ns = now_;
  for (int i = 0; i < joints(); ++i) {
    auto& j = commands.joints[i];
    j = {};
    const double phase = kFrequency * t;
    switch (options_.mode) {
      case DriveMode::kCsp:
        j.kind = WB_CMD_POSITION;
        j.position = start_[static_cast<std::size_t>(i)] + 0.5 * kAmplitude * (1 - std::cos(phase));
        break;
      case DriveMode::kCsv:
        j.kind = WB_CMD_VELOCITY;
        j.velocity = kAmplitude * std::sin(phase);
        break;
      default:
        j.kind = WB_CMD_TORQUE;
        j.effort = kTorque * std::cos(phase);
        break;
    }
  }
}

void Rig::tick() {
  now_ = static_cast<TimeNs>(++ticks_) * kPeriod;
  (void)driver->advance(now_);
  (void)driver->read(readings);
  if (commanding && driver->state() == WB_ACTIVE) {
    compose();
    if (spoil) spoil(commands);
    written = driver->write(commands);
  }
  driver->drain_log([this](wb_log_level, const std::string& line) { log_ += line + "\n"; });
}

void Rig::run(double seconds, const std::function<bool()>& each) {
  const auto ticks = static_cast<std::uint64_t>(std::llround(seconds / to_seconds(kPeriod)));
  for (std::uint64_t i = 0; i < ticks; ++i) {
    tick();
    if (each && !each()) return;
  }
}

void Rig::babble(const Frame& frame, int per_step, int count) {
  babblers.push_back(std::make_unique<Babbler>(*buses.front(), frame, per_step, count));
}

void Rig::hush() {
  for (auto& b : babblers) b->hush();
}

void Rig::in_next_step(std::function<void()> what) {
  saboteurs.push_back(std::make_unique<Saboteur>(*buses.front(), std::move(what)));
}

void Rig::second_node(int node_id) {
  NodeOptions n;
  n.node_id = node_id;
  models.push_back(std::make_unique<IntegratorModel>());
  nodes.push_back(std::make_unique<Cia402Node>(n, *buses.front(), *models.back()));
}

void Rig::hang(double seconds) {
  const auto ticks = static_cast<std::uint64_t>(std::llround(seconds / to_seconds(kPeriod)));
  for (auto& bus : buses) bus->advance(bus->now() + static_cast<TimeNs>(ticks) * kPeriod);
  ticks_ += ticks;
}

}  // namespace wb::can
