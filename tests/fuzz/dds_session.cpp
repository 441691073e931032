// The low-level computer's decision to command its drives, message after message: leases, commands,
// ticks, and the time between them. The harness keeps a book of its own of what may pass.
#include "tests/fuzz/dds_session.hpp"

#include <cmath>
#include <optional>

#include "drivers/dds/low_level/command_admission.hpp"
#include "drivers/dds/low_level/lease_book.hpp"
#include "drivers/dds/low_level/session_clock.hpp"
#include "tests/drivers/dds/fake_robot.hpp"
#include "tests/fuzz/dds_wire.hpp"

namespace wb::dds {
namespace {

constexpr TimeNs kMs = 1'000'000, kMemory = 100 * kMs, kLeaseSilence = 500 * kMs;
constexpr TimeNs kRosStart = 1'700'000'000 * kNanosPerSecond;

class Session {
 public:
  explicit Session(Bytes& bytes)
      : bytes_(bytes),
        robot_(fake_description()),
        leases_(kLeaseSilence),
        admission_(robot_),
        paced_(bytes.flag()) {}

  fuzz::Tally run() {
    ask();
    while (bytes_.left() > 0) {
      switch (bytes_.take<std::uint8_t>() % 16) {
        case 11:
          ask();
          break;
        case 12:
          if (leases_.release(1 + bytes_.take<std::uint8_t>() % 8)) lease_ended();
          break;
        case 13:
          pass(bytes_.take<std::uint16_t>() * kMs / 64);
          break;
        case 14:
          emergency_stop_ = bytes_.flag();
          if (emergency_stop_ && admission_.moving()) stop();
          break;
        case 15:
          tick();
          break;
        default:
          command();
          pass(bytes_.take<std::uint8_t>() * kMs / 64);
      }
      ++tally_.records;
    }
    return tally_;
  }

 private:
  TimeNs stamp_now() const { return paced_ ? clock_.host_ns() : kRosStart + wall_ns_; }
  TimeNs command_clock() const { return paced_ ? clock_.now_ns() : wall_ns_; }

  void ask() {
    const LeaseBook::Answer answer =
        leases_.ask(1 + bytes_.take<std::uint8_t>() % 8, "fuzzer", wall_ns_);
    if (!answer.is_new) return;
    admission_.begin_lease();
    promise(!admission_.moving(), "a new lease moves nothing");
    lease_ = answer.lease;
    newest_ = 0;
    stopped_ = false;
    moving_until_.reset();
  }
  void lease_ended() {
    promise(admission_.end_lease() == moving_until_.has_value(),
            "the end of a lease stops what moves");
    former_ = lease_;
    lease_ = 0;
    moving_until_.reset();
  }
  void stop() {
    admission_.latch_stop();
    stopped_ = true;
    moving_until_.reset();
  }
  void watch() {
    promise(admission_.deadline_ns() == moving_until_.value_or(INT64_MAX), "the deadline is known");
    if (command_clock() > admission_.deadline_ns()) stop();
  }
  void pass(TimeNs ns) {
    wall_ns_ += ns;
    watch();
    if (leases_.expire(wall_ns_)) lease_ended();
  }

  void command() {
    msg::JointCommands c{};
    const auto who = bytes_.take<std::uint8_t>();
    c.lease_ = who % 8 == 6 ? former_ : who % 8 == 7 ? bytes_.take<std::uint64_t>() : lease_;
    c.sequence_ = newest_ + 1;
    if (who & 0x80) c.sequence_ += bytes_.take<std::int8_t>();
    c.stamp_ns_ = stamp_now();
    if (who & 0x40) c.stamp_ns_ += bytes_.take<std::int16_t>() * (kMs / 64);
    c.valid_for_ns_ = 50 * kMs;
    c.stop_ = (who & 0x3F) == 0x3F;
    c.joint_count_ = robot_.joint_count;
    for (std::uint32_t i = 0; i < c.joint_count_; ++i) {
      c.kind_[i] = WB_CMD_VELOCITY;
      c.velocity_[i] = 0.1;
    }
    const Wired<msg::JointCommands> wired(c, bytes_);
    if (wired.taken()) take(wired.message());
  }

  void take(const msg::JointCommands& c) {
    CommandAdmission::Moment m;
    m.lease = leases_.lease();
    m.stamp_ns = stamp_now();
    m.memory_ns = paced_ ? 0 : kMemory;
    m.now_ns = command_clock();
    m.emergency_stop = emergency_stop_;
    const bool holders = lease_ != 0 && c.lease_ == lease_;
    const bool in_order = c.sequence_ > newest_;
    if (holders) newest_ = std::max(newest_, c.sequence_);
    wb_commands out{};
    const CommandAdmission::Verdict verdict = admission_.take(c, m, out);
    if (verdict == CommandAdmission::Verdict::kRefused) return;
    promise(holders, "a command of a lease that nobody holds");
    promise(in_order, "a command twice or out of order");
    leases_.heard(wall_ns_);
    if (verdict != CommandAdmission::Verdict::kApply) {
      promise(c.stop_, "a stop that nobody sent");
      stopped_ = true;
      moving_until_.reset();
      return;
    }
    promise(!c.stop_ && !stopped_, "a command after a stop");
    promise(!emergency_stop_, "a command during the emergency stop");
    promise(c.stamp_ns_ <= m.stamp_ns + kFutureNs, "a command from the future");
    promise(c.stamp_ns_ >= (paced_ ? 0 : m.stamp_ns - kMemory), "a stale command");
    promise(c.valid_for_ns_ > 0 && c.valid_for_ns_ <= kValidForMaxNs, "a command for ever");
    promise(within_limits(out, robot_), "a command beyond a joint's limits");
    if (paced_) out.t_ns += clock_.offset_ns();
    moving_until_ = m.now_ns + c.valid_for_ns_;
    ++tally_.taken;
  }

  void tick() {
    msg::Tick t{};
    t.session_ = 1 + bytes_.take<std::uint8_t>() % 2;
    t.number_ = clock_.tick() + 1;
    t.t_ns_ = clock_.host_ns() + 2'500'000;
    const Wired<msg::Tick> wired(t, bytes_);
    if (!paced_ || !wired.taken()) return;
    const msg::Tick& got = wired.message();
    const std::uint64_t session = clock_.session();
    const TimeNs before = clock_.now_ns(), silence = wall_ns_ - tick_ns_;
    const SessionClock::Verdict verdict = clock_.take(got, wall_ns_);
    if (verdict == SessionClock::Verdict::kRefused) return;
    promise(session == 0 || session == got.session_ || silence >= kNanosPerSecond,
            "a second host turns the clock");
    tick_ns_ = wall_ns_;
    if (verdict == SessionClock::Verdict::kGoOn) {
      promise(clock_.robot_ns(got) >= before, "the robot's time goes back");
      clock_.reach(clock_.robot_ns(got));
      watch();
    }
    clock_.answer(got);
  }

  Bytes& bytes_;
  const wb_description robot_;
  LeaseBook leases_;
  CommandAdmission admission_;
  SessionClock clock_;
  const bool paced_;
  fuzz::Tally tally_;

  // The book.
  TimeNs wall_ns_ = 0, tick_ns_ = 0;
  std::uint64_t lease_ = 0, former_ = 0, newest_ = 0;  // newest sequence of the lease
  bool stopped_ = false, emergency_stop_ = false;
  std::optional<TimeNs> moving_until_;
};

}  // namespace

bool within_limits(const wb_commands& out, const wb_description& robot) {
  for (std::uint32_t i = 0; i < robot.joint_count; ++i) {
    const auto& j = out.joints[i];
    const wb_joint_info& limits = robot.joints[i];
    // Comparisons are false for what is not a number.
    if (j.kind != WB_CMD_NONE && !(limits.command_kinds & (1u << j.kind))) return false;
    if (!(std::abs(j.velocity) <= limits.velocity_max && std::abs(j.effort) <= limits.effort_max))
      return false;
    if (!std::isfinite(j.position + j.stiffness + j.damping)) return false;
    if (limits.position_min < limits.position_max &&
        !(j.position >= limits.position_min && j.position <= limits.position_max) &&
        j.kind != WB_CMD_NONE)
      return false;
    if (!(j.stiffness >= 0 && j.damping >= 0)) return false;
  }
  return std::isfinite(out.gripper.opening) && std::isfinite(out.gripper.force);
}

fuzz::Tally session(Bytes& bytes) { return Session(bytes).run(); }

}  // namespace wb::dds
