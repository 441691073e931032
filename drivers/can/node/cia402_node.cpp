#include "drivers/can/node/cia402_node.hpp"

#include <algorithm>

#include "drivers/can/node/drive_machine.hpp"
#include "drivers/can/node/sdo_server.hpp"

namespace wb::can {
namespace {

constexpr TimeNs kMs = 1'000'000;
constexpr TimeNs kNever = INT64_MAX;
constexpr int kMapEntries = 4;

// Emergency codes of CiA 301 that the node itself raises.
constexpr std::uint16_t kHeartbeatLost = 0x8130, kRpdoLate = 0x8250, kPdoLength = 0x8210;

bool is_map(std::uint16_t index) {
  return index == object::kRpdo1Map || index == object::kTpdo1Map || index == object::kTpdo2Map;
}
std::uint16_t parameters_of(std::uint16_t map) { return static_cast<std::uint16_t>(map - 0x200); }

}  // namespace

struct Cia402Node::State {
  State(const NodeOptions& o, InProcessBus& b, DriveModel& m)
      : options(o), bus(b), model(m), machine(m), sdo(objects, this, &State::written) {
    build();
  }

  NodeOptions options;
  InProcessBus& bus;
  DriveModel& model;
  CanPort* port = nullptr;
  NodeFaults faults;
  ObjectDictionary objects;
  DriveMachine machine;
  SdoServer sdo;
  std::uint8_t nmt_state = nmt::kPreOperational;
  bool booted = false;
  TimeNs now = 0, last_step = -1;
  TimeNs heartbeat_at = 0, consumer_deadline = kNever, rpdo_deadline = kNever;
  std::uint64_t followed = 0;
  // The RPDO that waits for its SYNC.
  Frame rpdo;
  bool rpdo_waits = false;
  // TPDOs that wait out tpdo_delay_ns.
  std::array<Frame, 2> late_tpdos;
  std::array<TimeNs, 2> late_at{kNever, kNever};
  int syncs = 0;
  std::uint16_t status_bits = 0;
  // Measured values as they stood when `frozen` was switched on.
  bool was_frozen = false;
  std::int32_t position = 0, velocity = 0, mirror = 0;
  std::int16_t torque = 0;

  void build() {
    const auto ro = [&](std::uint16_t i, int sub, int bytes, std::uint64_t v) {
      objects.add(i, static_cast<std::uint8_t>(sub), bytes, false, v);
    };
    const auto rw = [&](std::uint16_t i, int sub, int bytes, std::uint64_t v) {
      objects.add(i, static_cast<std::uint8_t>(sub), bytes, true, v);
    };
    const auto id = static_cast<std::uint32_t>(options.node_id);
    ro(object::kDeviceType, 0, 4, options.device_type);
    ro(object::kErrorRegister, 0, 1, 0);
    objects.add_text(object::kDeviceName, options.name);
    if (options.heartbeat_consumer) rw(object::kConsumerHeartbeat, 1, 4, 0);
    rw(object::kProducerHeartbeat, 0, 2, 0);
    ro(object::kIdentity, 0, 1, 4);
    ro(object::kIdentity, 1, 4, options.vendor);
    ro(object::kIdentity, 2, 4, options.product);
    ro(object::kIdentity, 3, 4, options.revision);
    ro(object::kIdentity, 4, 4, options.serial);
    rw(object::kErrorBehaviour, 1, 1, 0);
    rw(object::kRpdo1, 1, 4, cob::kRpdo1 + id);
    rw(object::kRpdo1, 2, 1, 255);
    rw(object::kRpdo1, 5, 2, 0);
    rw(object::kTpdo1, 1, 4, cob::kTpdo1 + id);
    rw(object::kTpdo1, 2, 1, 255);
    rw(object::kTpdo2, 1, 4, cob::kTpdo2 + id);
    rw(object::kTpdo2, 2, 1, 255);
    const auto map = [&](std::uint16_t index, std::uint64_t first) {
      rw(index, 0, 1, first ? 1 : 0);
      for (int i = 1; i <= kMapEntries; ++i) rw(index, i, 4, i == 1 ? first : 0);
    };
    map(object::kRpdo1Map, object::kControlword << 16 | 16u);
    map(object::kTpdo1Map, object::kStatusword << 16 | 16u);
    map(object::kTpdo2Map, 0);
    rw(object::kAbortConnection, 0, 2, 1);
    ro(object::kErrorCode, 0, 2, 0);
    rw(object::kControlword, 0, 2, 0);
    ro(object::kStatusword, 0, 2, 0);
    rw(object::kQuickStopOption, 0, 2, 2);
    rw(object::kFaultReactionOption, 0, 2, 2);
    rw(object::kMode, 0, 1, 0);
    ro(object::kModeDisplay, 0, 1, 0);
    ro(object::kPositionActual, 0, 4, 0);
    rw(object::kFollowingWindow, 0, 4, 0xFFFFFFFF);
    ro(object::kVelocityActual, 0, 4, 0);
    rw(object::kTargetTorque, 0, 2, 0);
    ro(object::kTorqueActual, 0, 2, 0);
    rw(object::kTargetPosition, 0, 4, 0);
    const auto counts = [&](double v) {
      return static_cast<std::uint32_t>(v * options.scale.counts_per_unit);
    };
    rw(object::kProfileDeceleration, 0, 4, counts(options.quick_stop_decel / 4));
    rw(object::kQuickStopDeceleration, 0, 4, counts(options.quick_stop_decel));
    rw(object::kInterpolationPeriod, 1, 1, 10);
    rw(object::kInterpolationPeriod, 2, 1, static_cast<std::uint8_t>(-4));  // 10 * 10^-4 s
    rw(object::kTargetVelocity, 0, 4, 0);
    ro(object::kSupportedModes, 0, 4, options.supported_modes);
  }

  DriveMachine::Limits limits() const {
    const double scale = options.scale.counts_per_unit;
    DriveMachine::Limits l;
    l.velocity_max = options.velocity_max;
    l.quick_stop_decel =
        static_cast<double>(objects.get(object::kQuickStopDeceleration, 0)) / scale;
    l.slow_down_decel = static_cast<double>(objects.get(object::kProfileDeceleration, 0)) / scale;
    l.power_delay_ns = options.enable_delay_ns;
    l.refuse_enable = faults.refuse_enable;
    l.keep_fault = faults.keep_fault;
    return l;
  }

  TimeNs interpolation_ns() const {
    auto ns = static_cast<double>(objects.get(object::kInterpolationPeriod, 1)) * 1e9;
    auto exponent = static_cast<std::int8_t>(objects.get(object::kInterpolationPeriod, 2));
    for (; exponent < 0; ++exponent) ns /= 10;
    return static_cast<TimeNs>(ns);
  }

  void send(std::uint32_t id, int length, const std::array<std::uint8_t, 8>& data) noexcept {
    if (faults.silent) return;
    Frame frame;
    frame.id = id;
    frame.length = static_cast<std::uint8_t>(length);
    frame.data = data;
    port->send(&frame, 1);
  }
  std::uint32_t id(std::uint32_t base) const noexcept {
    return base + static_cast<std::uint32_t>(options.node_id);
  }

  void emergency(std::uint16_t code) noexcept {
    std::array<std::uint8_t, 8> data{};
    put_bytes(data.data(), 2, code);
    data[2] = code == 0 ? 0 : 1;
    objects.set(object::kErrorRegister, 0, data[2]);
    if (nmt_state != nmt::kStopped) send(id(cob::kEmergency), 8, data);
  }

  // The master has gone: 0x1029 says what becomes of the NMT state, 0x6007 what of the motor.
  void lose_master(std::uint16_t code) noexcept {
    if (faults.ignore_silence) return;
    emergency(code);
    machine.connection_lost(static_cast<std::int16_t>(objects.get(object::kAbortConnection, 0)),
                            code);
    const auto behaviour = objects.get(object::kErrorBehaviour, 1);
    if (behaviour == 0 && nmt_state == nmt::kOperational) nmt_state = nmt::kPreOperational;
    if (behaviour == 2) nmt_state = nmt::kStopped;
    rpdo_waits = false;
  }

  static SdoAbort written(void* self, const Object& o, std::uint64_t value) noexcept {
    return static_cast<State*>(self)->write(o, value);
  }

  SdoAbort write(const Object& o, std::uint64_t value) noexcept {
    if (faults.refuse_sdo) return SdoAbort::kCannotStore;
    if (is_map(o.index)) {
      if ((objects.get(parameters_of(o.index), 1) & cob::kInvalid) == 0)
        return SdoAbort::kUnsupportedAccess;
      if (o.sub > 0 && objects.get(o.index, 0) != 0) return SdoAbort::kUnsupportedAccess;
      if (o.sub == 0) return check_map(o.index, static_cast<int>(value));
      const auto index = static_cast<std::uint16_t>(value >> 16);
      const Object* mapped = objects.find(index, static_cast<std::uint8_t>(value >> 8));
      if (!mapped || mapped->bytes * 8 != static_cast<int>(value & 0xFF))
        return SdoAbort::kNotMappable;
    }
    if (o.index == object::kConsumerHeartbeat) consumer_deadline = kNever;  // from the first beat
    if (o.index == object::kProducerHeartbeat) heartbeat_at = now;
    if (o.index == object::kMode) {
      if (value != 0 && (value < 8 || value > 10)) return SdoAbort::kRange;
      machine.set_mode(static_cast<DriveMode>(value));
    }
    if (o.index == object::kQuickStopOption) {
      if (value > 8) return SdoAbort::kRange;
      machine.set_quick_stop_option(static_cast<int>(value));
    }
    if (o.index == object::kControlword)
      machine.control(static_cast<std::uint16_t>(value), limits());
    return SdoAbort::kNone;
  }

  SdoAbort check_map(std::uint16_t index, int count) const noexcept {
    if (count > kMapEntries) return SdoAbort::kRange;
    std::uint64_t bits = 0;
    for (int i = 1; i <= count; ++i)
      bits += objects.get(index, static_cast<std::uint8_t>(i)) & 0xFF;
    return bits > 64 ? SdoAbort::kMappingTooLong : SdoAbort::kNone;
  }

  void answer_sdo(const Frame& frame) noexcept {
    if (frame.length != 8 || nmt_state == nmt::kStopped || faults.ignore_sdo) return;
    std::array<std::uint8_t, 8> reply{};
    if (!sdo.answer(frame.data, reply, faults.wrong_toggle)) return;
    const auto index = static_cast<std::uint16_t>(get_bytes(&frame.data[1], 2));
    if (faults.swap_mapping && frame.data[0] == 0x40 && is_map(index) && frame.data[3] == 1)
      reply[4] ^= 0x30;
    if (faults.refuse_sdo && (reply[0] & 0xE0) != 0x80) {
      reply[0] = 0x80;
      put_bytes(&reply[4], 4, static_cast<std::uint32_t>(SdoAbort::kCannotStore));
    }
    send(id(cob::kSdoAnswer), 8, reply);
  }

  void obey_nmt(const Frame& frame) noexcept {
    if (frame.length != 2 || (frame.data[1] != 0 && frame.data[1] != options.node_id)) return;
    switch (frame.data[0]) {
      case nmt::kStart:
        nmt_state = nmt::kOperational;
        break;
      case nmt::kStop:
        nmt_state = nmt::kStopped;
        break;
      case nmt::kEnterPreOperational:
        nmt_state = nmt::kPreOperational;
        break;
      case nmt::kResetNode:
      case nmt::kResetCommunication:
        boot();
        break;
      default:
        return;
    }
    rpdo_waits = false;
    rpdo_deadline = kNever;
    if (nmt_state != nmt::kOperational && booted) machine.connection_lost(3, 0);
  }

  void boot() noexcept {
    objects = ObjectDictionary();
    build();
    machine.reset();
    sdo.reset();
    nmt_state = nmt::kPreOperational;
    booted = rpdo_waits = false;
    consumer_deadline = rpdo_deadline = kNever;
    late_at = {kNever, kNever};
  }

  void measure() noexcept {
    if (!faults.frozen || !was_frozen) {
      // The counter wraps, as a drive's does.
      position = static_cast<std::int32_t>(
          static_cast<std::uint32_t>(options.scale.position_counts64(model.position())));
      velocity = options.scale.velocity_counts(model.velocity());
      torque = options.scale.torque_permille(model.torque());
    }
    was_frozen = faults.frozen;
    if (!faults.reversed) mirror = position;
    if (faults.reversed)
      position = static_cast<std::int32_t>(2u * static_cast<std::uint32_t>(mirror) -
                                           static_cast<std::uint32_t>(position));
    objects.set(
        object::kStatusword, 0,
        static_cast<std::uint16_t>((machine.statusword() | status_bits) ^ faults.statusword_xor));
    objects.set(object::kModeDisplay, 0,
                faults.wrong_mode ? 0 : static_cast<std::uint8_t>(machine.mode()));
    objects.set(
        object::kPositionActual, 0,
        static_cast<std::uint32_t>(position) + static_cast<std::uint32_t>(faults.position_jump));
    objects.set(object::kVelocityActual, 0, static_cast<std::uint32_t>(velocity));
    objects.set(object::kTorqueActual, 0, static_cast<std::uint16_t>(torque));
    objects.set(object::kErrorCode, 0, machine.error_code());
  }

  // Packs or unpacks a PDO by its mapping; returns its length in bytes.
  template <class F>
  int each_mapped(std::uint16_t map, F&& f) noexcept {
    int at = 0;
    const auto count = objects.get(map, 0);
    for (std::uint8_t i = 1; i <= count; ++i) {
      const auto entry = objects.get(map, i);
      const int bytes = static_cast<int>(entry & 0xFF) / 8;
      if (Object* o = objects.find(static_cast<std::uint16_t>(entry >> 16),
                                   static_cast<std::uint8_t>(entry >> 8)))
        f(*o, at, bytes);
      at += bytes;
    }
    return at;
  }

  void take_rpdo() noexcept {
    rpdo_waits = false;
    each_mapped(object::kRpdo1Map, [&](Object& o, int at, int bytes) {
      o.value = get_bytes(&rpdo.data[static_cast<std::size_t>(at)], bytes);
    });
    const auto word = static_cast<std::uint16_t>(objects.get(object::kControlword, 0));
    if (faults.ignore_stop && machine.state() == DriveState::kOperationEnabled &&
        !controlword::enables(word))
      return;
    const auto mode = objects.get(object::kMode, 0);
    if (mode >= 8 && mode <= 10) machine.set_mode(static_cast<DriveMode>(mode));
    machine.control(word, limits());
    if (faults.ignore_targets) return;
    const UnitScale& scale = options.scale;
    const DriveTargets targets{
        scale.position(static_cast<std::int32_t>(objects.get(object::kTargetPosition, 0))),
        scale.velocity(static_cast<std::int32_t>(objects.get(object::kTargetVelocity, 0))),
        scale.torque(static_cast<std::int16_t>(objects.get(object::kTargetTorque, 0)))};
    if (machine.follow(targets, now, interpolation_ns())) ++followed;
  }

  void sync() noexcept {
    if (nmt_state != nmt::kOperational) return;
    if (rpdo_waits) take_rpdo();
    measure();
    ++syncs;
    send_tpdo(0, object::kTpdo1, object::kTpdo1Map);
    send_tpdo(1, object::kTpdo2, object::kTpdo2Map);
  }

  void send_tpdo(int which, std::uint16_t parameters, std::uint16_t map) noexcept {
    const auto cob_id = objects.get(parameters, 1);
    const auto type = objects.get(parameters, 2);
    if ((cob_id & cob::kInvalid) || type == 0 || type > 240 ||
        syncs % static_cast<int>(type) != 0 || faults.no_tpdo)
      return;
    Frame frame;
    frame.id = static_cast<std::uint32_t>(cob_id & 0x7FF);
    frame.length = static_cast<std::uint8_t>(each_mapped(map, [&](Object& o, int at, int bytes) {
      put_bytes(&frame.data[static_cast<std::size_t>(at)], bytes, o.value);
    }));
    if (faults.tpdo_delay_ns == 0) return send(frame.id, frame.length, frame.data);
    late_tpdos[static_cast<std::size_t>(which)] = frame;
    late_at[static_cast<std::size_t>(which)] = now + faults.tpdo_delay_ns;
  }
};

Cia402Node::Cia402Node(const NodeOptions& options, InProcessBus& bus, DriveModel& model)
    : state_(std::make_unique<State>(options, bus, model)) {
  state_->port = &bus.attach("node " + std::to_string(options.node_id), this);
}
Cia402Node::~Cia402Node() { state_->bus.detach(*state_->port); }

void Cia402Node::received(const Frame& frame) noexcept {
  State& s = *state_;
  s.now = frame.t_ns;
  if (frame.extended || frame.remote || !s.booted) return;
  if (frame.id == cob::kNmt) return s.obey_nmt(frame);
  if (frame.id == cob::kSync && frame.length <= 1) return s.sync();
  if (frame.id == s.id(cob::kSdoRequest)) return s.answer_sdo(frame);
  if (frame.id == (s.objects.get(object::kRpdo1, 1) & 0xFFFFFFFF)) {
    if (s.nmt_state != nmt::kOperational) return;
    const int length = s.each_mapped(object::kRpdo1Map, [](Object&, int, int) {});
    if (frame.length != length) return s.emergency(kPdoLength);
    s.rpdo = frame;
    s.rpdo_waits = true;
    const auto timeout = static_cast<TimeNs>(s.objects.get(object::kRpdo1, 5));
    s.rpdo_deadline = timeout > 0 ? s.now + timeout * kMs : kNever;
    return;
  }
  const auto consumer = s.objects.get(object::kConsumerHeartbeat, 1);
  if ((consumer & 0xFFFF) != 0 && frame.id == cob::kHeartbeat + ((consumer >> 16) & 0x7F))
    s.consumer_deadline = s.now + static_cast<TimeNs>(consumer & 0xFFFF) * kMs;
}

void Cia402Node::step(TimeNs now) noexcept {
  State& s = *state_;
  s.now = now;
  if (!s.booted) {
    s.booted = true;
    s.send(s.id(cob::kHeartbeat), 1, {nmt::kBootUp});
    s.heartbeat_at = now;
  }
  const double dt_s = s.last_step < 0 ? 0 : to_seconds(now - s.last_step);
  s.last_step = now;
  s.machine.step(now, dt_s, s.limits());
  if (s.consumer_deadline <= now) {
    s.consumer_deadline = kNever;
    s.lose_master(kHeartbeatLost);
  }
  if (s.rpdo_deadline <= now) {
    s.rpdo_deadline = kNever;
    s.lose_master(kRpdoLate);
  }
  const auto period = static_cast<TimeNs>(s.objects.get(object::kProducerHeartbeat, 0)) * kMs;
  if (period > 0 && now >= s.heartbeat_at) {
    s.heartbeat_at = now + period;
    if (!s.faults.no_heartbeat) s.send(s.id(cob::kHeartbeat), 1, {s.nmt_state});
  }
  for (std::size_t i = 0; i < s.late_at.size(); ++i) {
    if (s.late_at[i] > now) continue;
    s.late_at[i] = kNever;
    s.send(s.late_tpdos[i].id, s.late_tpdos[i].length, s.late_tpdos[i].data);
  }
}

NodeFaults& Cia402Node::faults() { return state_->faults; }
CanPort& Cia402Node::port() { return *state_->port; }
int Cia402Node::node_id() const { return state_->options.node_id; }
void Cia402Node::reboot() noexcept { state_->boot(); }
void Cia402Node::raise(std::uint16_t error_code) noexcept {
  state_->emergency(error_code);
  if (error_code != 0) state_->machine.fault(error_code);
}
void Cia402Node::send_emergency(std::uint16_t code) noexcept { state_->emergency(code); }
void Cia402Node::enter_quick_stop() noexcept { state_->machine.quick_stop(true); }
void Cia402Node::set_limit_bit(bool on) noexcept {
  state_->status_bits = static_cast<std::uint16_t>(on ? state_->status_bits | statusword::kLimit
                                                      : state_->status_bits & ~statusword::kLimit);
}
void Cia402Node::set_following_error_bit(bool on) noexcept {
  state_->status_bits =
      static_cast<std::uint16_t>(on ? state_->status_bits | statusword::kFollowingError
                                    : state_->status_bits & ~statusword::kFollowingError);
}
void Cia402Node::set_nmt(std::uint8_t state) noexcept { state_->nmt_state = state; }
std::uint8_t Cia402Node::nmt() const { return state_->nmt_state; }
std::uint16_t Cia402Node::statusword() const { return state_->machine.statusword(); }
bool Cia402Node::enabled() const {
  return state_->machine.state() == DriveState::kOperationEnabled;
}
std::uint64_t Cia402Node::object(std::uint16_t index, std::uint8_t sub) const {
  return state_->objects.get(index, sub);
}
std::uint64_t Cia402Node::rpdos_followed() const { return state_->followed; }

}  // namespace wb::can
