#include "drivers/can/bus_master.hpp"

#include <algorithm>

#include "drivers/can/canopen/objects.hpp"

namespace wb::can {
namespace {

constexpr TimeNs kMs = 1'000'000;
constexpr TimeNs kReopenNs = 100 * kMs;
// After deactivate: quick stop for so long, then no power.
constexpr TimeNs kClosingNs = 300 * kMs;
// Frames taken from the port at once, and in one collect(): a babbling node cannot hold the loop.
constexpr int kChunk = 64, kChunks = 16;

}  // namespace

BusMaster::BusMaster(int bus, CanPort& port, const Supervision& supervision,
                     std::vector<Member> drives, EventSink& events, StopLatch& latch)
    : bus_(bus),
      port_(port),
      supervision_(supervision),
      drives_(std::move(drives)),
      events_(events),
      latch_(latch),
      status_(port.status()),
      first_bus_offs_(status_.bus_offs) {}

void BusMaster::report(Event event, std::uint32_t value, std::uint64_t times) RT_SAFE {
  events_.report({now_, event, bus_, -1, value}, times);
}

void BusMaster::collect(TimeNs now) RT_SAFE {
  now_ = now;
  std::array<Frame, kChunk> frames;
  for (int chunk = 0; chunk < kChunks; ++chunk) {
    const int n = port_.receive(frames.data(), kChunk);
    for (int i = 0; i < n; ++i) {
      const Frame& frame = frames[static_cast<std::size_t>(i)];
      const auto owner = std::find_if(drives_.begin(), drives_.end(),
                                      [&](const Member& d) { return d.protocol->owns(frame); });
      if (owner != drives_.end()) {
        owner->protocol->received(frame);
      } else {
        take_foreign(frame);
      }
    }
    if (n < kChunk) break;
  }
}

// The port does not hand out our own frames: whoever sends what only a master sends is another one.
void BusMaster::take_foreign(const Frame& frame) RT_SAFE {
  bool masters = frame.id == cob::kNmt || frame.id == cob::kSync ||
                 frame.id == cob::kHeartbeat + static_cast<std::uint32_t>(supervision_.master_id);
  for (const Member& d : drives_) {
    const auto n = static_cast<std::uint32_t>(d.node_id);
    masters = masters || frame.id == cob::kRpdo1 + n || frame.id == cob::kSdoRequest + n;
  }
  report(masters && !frame.extended ? Event::kSecondMaster : Event::kForeignFrame, frame.id);
}

void BusMaster::check_link(TimeNs now) RT_SAFE {
  const PortStatus before = status_;
  status_ = port_.status();
  if (status_.error_frames > before.error_frames)
    report(Event::kErrorFrames, 0, status_.error_frames - before.error_frames);
  if (status_.overruns > before.overruns)
    report(Event::kReceiveOverrun, 0, status_.overruns - before.overruns);
  if (status_.state == LinkState::kPassive && before.state != LinkState::kPassive)
    report(Event::kErrorPassive);
  const auto bus_offs = static_cast<std::uint32_t>(status_.bus_offs - first_bus_offs_);
  if (bus_offs > static_cast<std::uint32_t>(supervision_.bus_off_max)) {
    if (status_.bus_offs > before.bus_offs || (was_active_ && !latch_.stopped()))
      report(Event::kBusOffLimit, bus_offs);
    status_.state = LinkState::kBusOff;
  } else if (status_.bus_offs > before.bus_offs) {
    // Seen here even where the kernel has restarted the controller meanwhile.
    report(Event::kBusOff, bus_offs);
    port_.flush();
  }
  if (carries()) {
    if (!carries_frames(before.state)) {
      port_.flush();
      report(Event::kLinkBack);
    }
    return;
  }
  port_.flush();
  // An adapter that is pulled goes down first; that it has gone then is news.
  if (before.state != status_.state || (was_active_ && !latch_.stopped())) {
    if (status_.state == LinkState::kDown) report(Event::kLinkDown);
    if (status_.state == LinkState::kGone) report(Event::kLinkGone);
    if (status_.state == LinkState::kBusOff && was_active_) report(Event::kBusOff, bus_offs);
  }
  if (status_.state >= LinkState::kDown && now >= reopen_at_) {
    reopen_at_ = now + kReopenNs;
    (void)port_.reopen();
  }
}

Goal BusMaster::goal_of(const Member& drive, const BusCommand& command) const RT_SAFE {
  if (!command.active) return now_ < closing_until_ ? Goal::kStop : Goal::kOff;
  if (latch_.stopped() || command.none[static_cast<std::size_t>(drive.joint)]) return Goal::kStop;
  return Goal::kOn;
}

void BusMaster::cycle(TimeNs now, const BusCommand& command) RT_SAFE {
  now_ = now;
  ++cycles_;
  if (command.activation != activation_) {
    activation_ = command.activation;
    for (Member& d : drives_) {
      d.protocol->retry();
      d.protocol->set_stop_action(command.actions[static_cast<std::size_t>(d.joint)]);
    }
  }
  if (was_active_ && !command.active) closing_until_ = now + kClosingNs;
  was_active_ = command.active;
  check_link(now);
  for (Member& d : drives_) d.protocol->check(now, goal_of(d, command));
  if (command.active && !latch_.stopped() && now - command.alive_at_ns > command.timeout_ns)
    report(Event::kCommandTimeout, static_cast<std::uint32_t>((now - command.alive_at_ns) / kMs));
  // From here on the latch is what it is: one fault of anybody stops all.
  const bool stopped = latch_.stopped();
  if (stopped && !was_stopped_) port_.flush();
  was_stopped_ = stopped;
  if (carries()) send(now, command);
}

void BusMaster::send(TimeNs now, const BusCommand& command) RT_SAFE {
  // Targets, SYNC, and whatever else may wait: it must not delay the answers.
  std::array<Frame, kMaxDrives * JointProtocol::kFrames + 2> frames;
  std::array<Frame, kMaxDrives * JointProtocol::kFrames> others;
  std::array<Frame, JointProtocol::kFrames> made;
  std::size_t count = 0, later = 0;
  for (Member& d : drives_) {
    const int n = d.protocol->transmit(
        now, goal_of(d, command), command.targets[static_cast<std::size_t>(d.joint)], made.data());
    for (std::size_t i = 0; i < static_cast<std::size_t>(n); ++i) {
      const bool target = made[i].id == cob::kRpdo1 + static_cast<std::uint32_t>(d.node_id);
      (target ? frames[count++] : others[later++]) = made[i];
    }
  }
  frames[count++].id = cob::kSync;
  if (now >= heartbeat_at_) {
    heartbeat_at_ = now + supervision_.heartbeat_ms * kMs;
    Frame& beat = frames[count++];
    beat.id = cob::kHeartbeat + static_cast<std::uint32_t>(supervision_.master_id);
    beat.length = 1;
    beat.data[0] = nmt::kOperational;
  }
  std::copy_n(others.begin(), later, frames.begin() + static_cast<std::ptrdiff_t>(count));
  count += later;
  if (port_.send(frames.data(), static_cast<int>(count)) == static_cast<int>(count)) {
    refused_ = 0;
    return;
  }
  // What waits in the queue is old by now: the next cycle's frames are to leave, not these.
  port_.flush();
  if (++refused_ >= supervision_.refused_max)
    report(Event::kTransmitRefused, static_cast<std::uint32_t>(refused_));
}

void BusMaster::publish(TimeNs now, BusReadings& readings) const RT_SAFE {
  readings.t_ns = now;
  readings.cycles = cycles_;
  readings.port = status_;
  readings.ready = readings.failed = 0;
  for (const Member& d : drives_) {
    readings.joints[static_cast<std::size_t>(d.joint)] = d.protocol->measurement();
    readings.ready += d.protocol->ready();
    readings.failed += d.protocol->failed();
  }
}

}  // namespace wb::can
