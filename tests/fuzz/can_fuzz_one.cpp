// Promises, whatever is received, in every state: no crash, nothing undefined (sanitizers), and no
// command to a drive that the state machine does not allow: a controlword that enables leaves only
// while the driver is active and not stopped, to a drive whose recent statusword is switched on or
// operation enabled; its target lies in the joint's range.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>

#include "drivers/can/canopen/objects.hpp"
#include "drivers/can/cia402/states.hpp"
#include "drivers/can/faults/rig.hpp"
#include "tests/fuzz/can_fuzz.hpp"

namespace wb::can {
namespace {

constexpr int kDrives = 2;
constexpr double kRangeRad = 2 + 0.1 * 4;  // the rig's limits and the driver's margin

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
    if (mode_ != DriveMode::kCsp) return;
    const auto counts = static_cast<std::int32_t>(get_bytes(&f.data[3], 4));
    promise(std::abs(rig_.driver->config().drives[node - 1].scale.position(counts)) <= kRangeRad,
            "a target outside the joint's range");
  }
  std::uint64_t enabling = 0;

 private:
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

}  // namespace

std::uint64_t fuzz_one(const std::uint8_t* data, std::size_t size) {
  if (size < kFuzzHeader) return 0;
  RigOptions options;
  options.drives = kDrives;
  constexpr DriveMode kModes[] = {DriveMode::kCsp, DriveMode::kCsv, DriveMode::kCst};
  options.mode = kModes[data[0] % 3];
  options.supervision.setup_timeout_ms = 300;
  Rig rig(options);
  Judge judge(rig, options.mode);
  bring_to(rig, data[1] % 5);
  for (std::size_t at = kFuzzHeader; at + kFuzzRecord <= size; at += kFuzzRecord) {
    const std::uint8_t* record = data + at;
    rig.ports[0]->inject.insert(rig.ports[0]->inject.begin(),
                                frame_of(record, rig.buses[0]->now() + record[3] * 4096));
    switch (record[0] &
            15) {  // after most frames time goes on; now and then the host does something
      case 0:
        break;
      case 1:
        (void)rig.driver->deactivate();
        break;
      case 2:
        if (rig.driver->state() == WB_UNCONFIGURED) (void)rig.driver->configure();
        (void)rig.activate();
        break;
      case 3:
        (void)rig.driver->stop();
        break;
      default:
        if (rig.driver->state() == WB_UNCONFIGURED) {
          (void)rig.driver->configure();
        } else {
          rig.tick();
        }
    }
  }
  if (rig.driver->state() != WB_UNCONFIGURED) rig.run(0.05);
  return judge.enabling;
}

}  // namespace wb::can
