// One input is a mode, a moment, and frames that somebody puts on the master's bus from then on,
// between calls of the driver.
// Promises, whatever is received, in every state: no crash, nothing undefined (sanitizers), and no
// command to a drive that the state machine does not allow: a controlword that enables leaves only
// while the driver is active and not stopped, to a drive whose recent statusword is switched on or
// operation enabled; its target lies in the joint's limits.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "drivers/can/canopen/objects.hpp"
#include "drivers/can/cia402/states.hpp"
#include "drivers/can/faults/rig.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace wb::can {
namespace {

constexpr int kDrives = 2;
constexpr std::size_t kHeader = 2, kRecord = 12;  // bytes
constexpr int kTicks = 12;                        // of a record: time goes on to the next tick
constexpr double kMarginRad = 0.1 * 4;            // by which a drive may hold beyond its range

void promise(bool kept, const char* what) {
  if (kept) return;
  std::fprintf(stderr, "broken promise: %s\n", what);
  std::abort();
}

// Our own book of what the drives said, from the frames that the master got.
class Judge {
 public:
  explicit Judge(Rig& rig, DriveMode mode) : rig_(rig), mode_(mode) {
    rig.ports[0]->got = [this](const Frame& f) { got(f); };
    rig.ports[0]->sent = [this](const Frame& f) { sent(f); };
  }
  ~Judge() { rig_.ports[0]->got = rig_.ports[0]->sent = nullptr; }
  void got(const Frame& f) {
    if (f.extended || f.remote || f.error || f.length != 8) return;
    if (f.id <= cob::kTpdo1 || f.id > cob::kTpdo1 + kDrives) return;
    const DriveState s = state_of(static_cast<std::uint16_t>(get_bytes(f.data.data(), 2)));
    if (s == DriveState::kSwitchedOn || s == DriveState::kOperationEnabled)
      willing_at_[f.id - cob::kTpdo1] = f.t_ns;
  }
  void sent(const Frame& f) {
    if (f.id <= cob::kRpdo1 || f.id > cob::kRpdo1 + kDrives) return;
    if (!controlword::enables(static_cast<std::uint16_t>(get_bytes(f.data.data(), 2)))) return;
    ++enabling;
    promise(rig_.driver->state() == WB_ACTIVE, "enabled while not active");
    promise(rig_.driver->stop_event() < 0, "enabled after a stop");
    const auto node = f.id - cob::kRpdo1;
    const TimeNs recent = 6 * Rig::kPeriod;
    promise(willing_at_.contains(node) && rig_.buses[0]->now() - willing_at_[node] <= recent,
            "enabled a drive that was not switched on");
    promise(target_allowed(rig_.driver->config().drives[node - 1], f),
            "a target outside the joint's limits");
  }
  std::uint64_t enabling = 0;

 private:
  bool target_allowed(const DriveConfig& d, const Frame& f) const {
    const UnitScale& scale = d.scale;
    if (mode_ == DriveMode::kCst) {
      const auto torque = static_cast<std::int16_t>(get_bytes(&f.data[3], 2));
      return std::abs(scale.torque(torque)) <= d.effort_max + scale.torque_per_permille;
    }
    const auto counts = static_cast<std::int32_t>(get_bytes(&f.data[3], 4));
    if (mode_ == DriveMode::kCsv)
      return std::abs(scale.velocity(counts)) <= d.velocity_max + 1 / scale.counts_per_unit;
    return scale.position(counts) >= d.position_min - kMarginRad &&
           scale.position(counts) <= d.position_max + kMarginRad;
  }

  Rig& rig_;
  DriveMode mode_;
  std::map<std::uint32_t, TimeNs> willing_at_;
};

// Where the input begins: while drives are set up, inactive, enabling, moving, stopped.
void bring_to(Rig& rig, int moment) {
  if (moment == 0) return;
  promise(rig.driver->configure() == WB_OK, "an undisturbed bus is set up");
  rig.tick();
  if (moment == 1) return;
  promise(rig.activate() == WB_OK, "undisturbed drives are activated");
  rig.run(moment == 2 ? 0.01 : 0.1);
  if (moment == 4) (void)rig.driver->stop();
}

Frame frame_of(const std::uint8_t* record, TimeNs now) {
  Frame f;
  f.extended = record[0] & 0x40;
  f.error = (record[0] & 0x30) == 0x30;
  f.remote = (record[0] & 0x30) == 0x20;
  f.id = static_cast<std::uint32_t>(get_bytes(&record[1], 2)) & 0x7FF;
  f.length = record[3] & 15;
  for (std::size_t i = 0; i < 8; ++i) f.data[i] = record[4 + i];
  f.t_ns = now;
  return f;
}

// The length that a frame of this identifier should have.
std::uint8_t length_of(std::uint32_t id) {
  const std::uint32_t base = id & 0x780;
  return id == 0 ? 2 : id == 0x080 ? 0 : base == 0x700 ? 1 : base == 0x280 || base == 0x200 ? 7 : 8;
}

}  // namespace
}  // namespace wb::can

namespace wb::fuzz {

using namespace wb::can;

const char* const kName = "can";
const char* const kRecords = "frames";
const char* const kTaken = "enabling commands to drives, each allowed";

Tally run_one(const std::uint8_t* data, std::size_t size) {
  if (size < kHeader) return {};
  RigOptions options;
  options.drives = kDrives;
  constexpr DriveMode kModes[] = {DriveMode::kCsp, DriveMode::kCsv, DriveMode::kCst};
  options.mode = kModes[data[0] % 3];
  options.supervision.setup_timeout_ms = 300;
  Rig rig(options);
  Judge judge(rig, options.mode);
  bring_to(rig, data[1] % 5);
  std::uint64_t frames = 0;
  for (std::size_t at = kHeader; at + kRecord <= size; at += kRecord, ++frames) {
    const std::uint8_t* record = data + at;
    rig.ports[0]->inject.insert(rig.ports[0]->inject.begin(),
                                frame_of(record, rig.buses[0]->now() + record[3] * 4096));
    // Several frames come within a tick, as on a full bus; now and then the host does something.
    const int then = record[0] & 15;
    if (then == 1) {
      (void)rig.driver->deactivate();
    } else if (then == 2 || then == 4) {
      if (rig.driver->state() == WB_UNCONFIGURED) (void)rig.driver->configure();
      if (rig.driver->stop_event() >= 0) (void)rig.driver->deactivate();  // the operator's reset
      (void)rig.activate();
    } else if (then == 3) {
      (void)rig.driver->stop();
    } else if (then >= kTicks) {
      if (rig.driver->state() == WB_UNCONFIGURED) {
        (void)rig.driver->configure();
      } else {
        rig.tick();
      }
    }
  }
  if (rig.driver->state() != WB_UNCONFIGURED) rig.run(0.05);
  return {frames, judge.enabling};
}

std::vector<std::uint8_t> seeded(std::mt19937_64& random) {
  constexpr std::size_t kFrames = 500;
  // Half of the identifiers are those that the two drives and the master use.
  constexpr std::uint16_t kIds[] = {0x000, 0x080, 0x081, 0x082, 0x181, 0x182, 0x281, 0x282,
                                    0x201, 0x202, 0x581, 0x582, 0x601, 0x701, 0x702, 0x77F};
  // Words that mean something.
  constexpr std::uint16_t kWords[] = {0x0000, 0x0250, 0x0231, 0x0233, 0x0237, 0x1237, 0x0217,
                                      0x0208, 0x020F, 0x0043, 0x7F43, 0x1860, 0x0005, 0x0080};
  const auto pick = [&](std::uint32_t n) { return static_cast<std::uint32_t>(random() % n); };
  std::vector<std::uint8_t> input(kHeader + kFrames * kRecord);
  for (auto& byte : input) byte = static_cast<std::uint8_t>(random());
  for (std::size_t i = 0; i < kFrames; ++i) {
    std::uint8_t* record = &input[kHeader + i * kRecord];
    // Every other stretch mostly holds frames that are nobody's, so that drives get enabled.
    if (i / 50 % 2 == 0 && pick(20)) {
      record[0] = static_cast<std::uint8_t>(pick(4) ? kTicks : pick(5));
      put_bytes(record + 1, 2, 0x300 + pick(0x200));
      continue;
    }
    if (pick(8)) record[0] &= 0x0F;  // mostly data frames with 11 bits
    if (pick(12)) record[0] = (record[0] & 0xF0) | (pick(3) ? 8 : kTicks);
    if (pick(2)) put_bytes(record + 1, 2, kIds[pick(std::size(kIds))]);
    if (pick(4)) record[3] = length_of(static_cast<std::uint32_t>(get_bytes(record + 1, 2)));
    if (pick(2)) put_bytes(record + 4, 2, kWords[pick(std::size(kWords))]);
    if (pick(2)) std::fill(record + 6, record + 12, 0);
  }
  return input;
}

}  // namespace wb::fuzz
