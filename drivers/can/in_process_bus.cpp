#include "drivers/can/in_process_bus.hpp"

#include <algorithm>
#include <utility>

namespace wb::can {
namespace {

// A queue of frames whose storage is allocated once.
class Ring {
 public:
  explicit Ring(int capacity) : frames_(static_cast<std::size_t>(capacity)) {}
  bool push(const Frame& frame) noexcept {
    if (count_ == frames_.size()) return false;
    frames_[(head_ + count_++) % frames_.size()] = frame;
    return true;
  }
  const Frame& front() const noexcept { return frames_[head_]; }
  void pop() noexcept {
    head_ = (head_ + 1) % frames_.size();
    --count_;
  }
  std::size_t size() const noexcept { return count_; }
  void clear() noexcept { count_ = 0; }

 private:
  std::vector<Frame> frames_;
  std::size_t head_ = 0, count_ = 0;
};

constexpr TimeNs kNever = INT64_MAX;

}  // namespace

class InProcessBus::Port final : public CanPort {
 public:
  Port(std::string name, BusParticipant* participant, const BusOptions& options)
      : name_(std::move(name)),
        participant_(participant),
        transmit_(options.transmit_queue),
        receive_(options.receive_queue) {}

  int send(const Frame* frames, int count) RT_SAFE override;
  int receive(Frame* frames, int capacity) RT_SAFE override {
    int n = 0;
    for (; n < capacity && receive_.size() > 0; ++n) {
      frames[n] = receive_.front();
      receive_.pop();
    }
    return n;
  }
  void flush() RT_SAFE override {
    status_.flushed += transmit_.size();
    transmit_.clear();
  }
  PortStatus status() RT_SAFE override { return status_; }
  bool reopen() RT_SAFE override { return carries_frames(status_.state); }

  bool sends() const noexcept {
    return attached_ && plugged_ && carries_frames(status_.state) && transmit_.size() > 0;
  }
  void take(const Frame& frame) noexcept {
    if (!attached_ || !plugged_ || !carries_frames(status_.state)) return;
    ++status_.received;
    if (participant_) {
      participant_->received(frame);
    } else if (!receive_.push(frame)) {
      ++status_.overruns;
    }
  }

  std::string name_;
  BusParticipant* participant_;
  Ring transmit_, receive_;
  PortStatus status_;
  bool attached_ = true, plugged_ = true;
  TimeNs recover_at_ = kNever;
};

struct InProcessBus::State {
  struct Held {
    Frame frame;
    Port* from;
    TimeNs due;  // kNever: with the next frame that matches
    std::uint32_t id, mask;
  };
  explicit State(const BusOptions& o) : options(o) { held.reserve(256); }

  BusOptions options;
  BusFaults faults;
  std::vector<std::unique_ptr<Port>> ports;
  TimeNs now = 0, next_step = 0;
  // The frame on the wire; ends at wire_end.
  Port* sender = nullptr;
  Frame wire;
  TimeNs wire_end = kNever;
  std::vector<Held> held;  // by a fault
  std::uint64_t frames_on_wire = 0;
  TimeNs busy_ns = 0;

  void begin_frame() noexcept {
    Port* winner = nullptr;
    // Arbitration: the lowest identifier; at equal bits a standard frame beats an extended one.
    const auto rank = [](const Frame& f) { return f.extended ? (f.id << 1 | 1u) : f.id << 19; };
    for (auto& port : ports) {
      if (port->sends() &&
          (!winner || rank(port->transmit_.front()) < rank(winner->transmit_.front())))
        winner = port.get();
    }
    if (!winner) return;
    sender = winner;
    wire = winner->transmit_.front();
    winner->transmit_.pop();
    const TimeNs duration = wire_time(wire, options.bit_rate);
    wire_end = now + duration;
    busy_ns += duration;
  }

  void deliver(Frame frame, const Port* from) noexcept {
    frame.t_ns = now;
    for (auto& port : ports) {
      if (port.get() != from) port->take(frame);
    }
  }

  void end_frame() noexcept {
    Port* from = std::exchange(sender, nullptr);
    wire_end = kNever;
    ++frames_on_wire;
    ++from->status_.sent;
    Frame frame = wire;
    const FaultRule* rule = faults.hit(frame);
    bool deliver_now = true, twice = false;
    if (rule) {
      switch (rule->fault) {
        case FrameFault::kDrop:
          deliver_now = false;
          break;
        case FrameFault::kDuplicate:
          twice = true;
          break;
        case FrameFault::kCorrupt:
          frame.data[rule->byte & 7] ^= rule->flip;
          break;
        case FrameFault::kLength:
          frame.length = static_cast<std::uint8_t>(rule->byte & 15);
          break;
        case FrameFault::kDelay:
        case FrameFault::kReorder:
          deliver_now = held.size() == held.capacity();
          if (!deliver_now) {
            const TimeNs due = rule->fault == FrameFault::kDelay ? now + rule->delay_ns : kNever;
            held.push_back({frame, from, due, rule->id, rule->mask});
          }
          return finish(frame, from, deliver_now, false, true);
      }
    }
    finish(frame, from, deliver_now, twice, false);
  }

  void finish(const Frame& frame, Port* from, bool deliver_now, bool twice,
              bool just_held) noexcept {
    if (deliver_now) deliver(frame, from);
    if (twice) deliver(frame, from);
    if (just_held) return;
    for (std::size_t i = 0; i < held.size();) {
      const Held h = held[i];
      if (h.due != kNever || (frame.id & h.mask) != h.id) {
        ++i;
        continue;
      }
      held.erase(held.begin() + static_cast<std::ptrdiff_t>(i));
      deliver(h.frame, h.from);
    }
  }

  void release_held() noexcept {
    for (std::size_t i = 0; i < held.size();) {
      const Held h = held[i];
      if (h.due > now) {
        ++i;
        continue;
      }
      held.erase(held.begin() + static_cast<std::ptrdiff_t>(i));
      deliver(h.frame, h.from);
    }
  }

  void recover_links() noexcept {
    for (auto& port : ports) {
      if (port->recover_at_ > now) continue;
      port->recover_at_ = kNever;
      if (port->status_.state == LinkState::kBusOff) ++port->status_.restarts;
      port->status_.state = LinkState::kActive;
    }
  }

  TimeNs next_event() const noexcept {
    TimeNs next = std::min(wire_end, next_step);
    for (const Held& h : held) next = std::min(next, h.due);
    for (const auto& port : ports) next = std::min(next, port->recover_at_);
    return next;
  }
};

int InProcessBus::Port::send(const Frame* frames, int count) RT_SAFE {
  int taken = 0;
  // A controller that is off the bus still queues, as the kernel does; without an interface not.
  const bool queues = attached_ && status_.state <= LinkState::kBusOff;
  while (queues && taken < count && transmit_.push(frames[taken])) ++taken;
  status_.refused += static_cast<std::uint64_t>(count - taken);
  return taken;
}

InProcessBus::InProcessBus(const BusOptions& options) : state_(std::make_unique<State>(options)) {}
InProcessBus::~InProcessBus() = default;

CanPort& InProcessBus::attach(const std::string& name, BusParticipant* participant) {
  state_->ports.push_back(std::make_unique<Port>(name, participant, state_->options));
  return *state_->ports.back();
}

void InProcessBus::detach(CanPort& port) {
  Port& p = static_cast<Port&>(port);
  p.attached_ = false;
  p.participant_ = nullptr;
  p.transmit_.clear();
  p.receive_.clear();
}

void InProcessBus::advance(TimeNs t) noexcept {
  State& s = *state_;
  while (s.now <= t) {
    if (!s.sender) s.begin_frame();
    const TimeNs next = s.next_event();
    if (next > t) break;
    s.now = std::max(s.now, next);
    if (s.wire_end <= s.now) s.end_frame();
    s.release_held();
    s.recover_links();
    if (s.next_step <= s.now) {
      for (std::size_t i = 0; i < s.ports.size(); ++i) {
        if (BusParticipant* p = s.ports[i]->participant_) p->step(s.now);
      }
      s.next_step += s.options.step_ns;
    }
  }
  s.now = std::max(s.now, t);
}

TimeNs InProcessBus::now() const { return state_->now; }
const BusOptions& InProcessBus::options() const { return state_->options; }
BusFaults& InProcessBus::faults() { return state_->faults; }

void InProcessBus::set_plugged(CanPort& port, bool plugged) noexcept {
  static_cast<Port&>(port).plugged_ = plugged;
}

void InProcessBus::set_link(CanPort& port, LinkState state, TimeNs recover_ns) noexcept {
  Port& p = static_cast<Port&>(port);
  if (state == LinkState::kBusOff && p.status_.state != LinkState::kBusOff) ++p.status_.bus_offs;
  if (carries_frames(state) && p.status_.state == LinkState::kBusOff) ++p.status_.restarts;
  p.status_.state = state;
  p.recover_at_ = recover_ns > 0 ? state_->now + recover_ns : kNever;
}

void InProcessBus::report_error_frames(CanPort& port, int count) noexcept {
  static_cast<Port&>(port).status_.error_frames += static_cast<std::uint64_t>(count);
}

std::uint64_t InProcessBus::frames_on_wire() const { return state_->frames_on_wire; }

double InProcessBus::load() const {
  return state_->now > 0 ? static_cast<double>(state_->busy_ns) / static_cast<double>(state_->now)
                         : 0.0;
}

}  // namespace wb::can
