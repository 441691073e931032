#include "drivers/can/cia402/drive_setup.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>

namespace wb::can {
namespace {

constexpr std::uint32_t entry(std::uint16_t index, int bits) {
  return static_cast<std::uint32_t>(index) << 16 | static_cast<std::uint32_t>(bits);
}

// 0x60C2: period = value * 10^exponent s, value at most 255.
void interpolation(double period_s, std::uint32_t& value, std::uint32_t& exponent) {
  for (int e = -4; e >= -6; --e) {
    const double v = period_s * std::pow(10.0, -e);
    if (std::abs(v - std::round(v)) > 1e-6 || v > 255) continue;
    value = static_cast<std::uint32_t>(std::lround(v));
    exponent = static_cast<std::uint8_t>(e);
    return;
  }
  throw std::runtime_error("sync_rate_hz: a period of " + std::to_string(1e3 * period_s) +
                           " ms cannot be written to 0x60C2 (whole tenths of ms, or below 2.55 ms "
                           "whole hundredths)");
}

}  // namespace

DriveSetup::DriveSetup(const DriveConfig& drive, const Supervision& s)
    : sdo_(drive.node_id, s.sdo_timeout_ms * TimeNs{1'000'000}), node_(drive.node_id) {
  using namespace object;
  const auto id = static_cast<std::uint32_t>(drive.node_id);
  steps_.push_back({Kind::kNmt, 0, 0, 0, nmt::kEnterPreOperational});
  const auto identify = [&](std::uint16_t index, int sub, std::uint32_t value) {
    if (value != 0) expect(index, sub, value, Event::kIdentity);
  };
  // Read in any case: it tells whether somebody is there.
  steps_.push_back({Kind::kExpect, kDeviceType, 0, 0, drive.device_type, Event::kIdentity});
  identify(kIdentity, 1, drive.vendor);
  identify(kIdentity, 2, drive.product);
  identify(kIdentity, 3, drive.revision);
  identify(kIdentity, 4, drive.serial);
  steps_.push_back({Kind::kName, kDeviceName});
  steps_.push_back({Kind::kMode, kSupportedModes, 0, 0, 1u << (static_cast<int>(drive.mode) - 1),
                    Event::kModeUnsupported});

  // The drive stops when the master dies: quick stop, and back to pre-operational, where RPDOs that
  // a queue still holds do nothing.
  write(kConsumerHeartbeat, 1, 4,
        static_cast<std::uint32_t>(s.master_id) << 16 |
            static_cast<std::uint32_t>(s.heartbeat_lost_ms));
  write(kProducerHeartbeat, 0, 2, static_cast<std::uint32_t>(s.heartbeat_ms));
  write(kErrorBehaviour, 1, 1, 0);
  write(kAbortConnection, 0, 2, 3);

  std::uint32_t value = 0, exponent = 0;
  interpolation(1.0 / s.sync_rate_hz, value, exponent);
  write(kInterpolationPeriod, 1, 1, value);
  write(kInterpolationPeriod, 2, 1, exponent);
  if (drive.quick_stop_decel > 0)
    write(kQuickStopDeceleration, 0, 4,
          static_cast<std::uint32_t>(
              std::min(4e9, drive.quick_stop_decel * drive.scale.counts_per_unit)));
  write(kMode, 0, 1, static_cast<std::uint32_t>(drive.mode));

  const std::uint32_t target = drive.mode == DriveMode::kCsp   ? entry(kTargetPosition, 32)
                               : drive.mode == DriveMode::kCsv ? entry(kTargetVelocity, 32)
                                                               : entry(kTargetTorque, 16);
  map(kRpdo1, cob::kRpdo1 + id, 1, {entry(kControlword, 16), entry(kMode, 8), target});
  write(kRpdo1, 5, 2, static_cast<std::uint32_t>(s.rpdo_timeout_ms));
  map(kTpdo1, cob::kTpdo1 + id, 1,
      {entry(kStatusword, 16), entry(kPositionActual, 32), entry(kTorqueActual, 16)});
  map(kTpdo2, cob::kTpdo2 + id, static_cast<std::uint32_t>(s.velocity_every),
      {entry(kVelocityActual, 32), entry(kModeDisplay, 8), entry(kErrorCode, 16)});
  steps_.push_back({Kind::kNmt, 0, 0, 0, nmt::kStart});
}

void DriveSetup::write(std::uint16_t index, int sub, int bytes, std::uint32_t value) {
  steps_.push_back({Kind::kWrite, index, static_cast<std::uint8_t>(sub),
                    static_cast<std::uint8_t>(bytes), value});
}

void DriveSetup::expect(std::uint16_t index, int sub, std::uint32_t value, Event trouble) {
  steps_.push_back({Kind::kExpect, index, static_cast<std::uint8_t>(sub), 0, value, trouble});
}

void DriveSetup::map(std::uint16_t parameters, std::uint32_t cob_id, std::uint32_t type,
                     const std::vector<std::uint32_t>& entries) {
  const auto mapping = static_cast<std::uint16_t>(parameters + 0x200);
  const auto count = static_cast<std::uint32_t>(entries.size());
  write(parameters, 1, 4, cob::kInvalid | cob_id);
  write(parameters, 2, 1, type);
  write(mapping, 0, 1, 0);
  for (std::size_t i = 0; i < entries.size(); ++i)
    write(mapping, static_cast<int>(i) + 1, 4, entries[i]);
  write(mapping, 0, 1, count);
  expect(mapping, 0, count, Event::kMappingDiffers);
  for (std::size_t i = 0; i < entries.size(); ++i)
    expect(mapping, static_cast<int>(i) + 1, entries[i], Event::kMappingDiffers);
  write(parameters, 1, 4, cob_id);
}

void DriveSetup::restart() RT_SAFE {
  at_ = 0;
  tries_ = 0;
  result_ = Result::kRunning;
  sdo_.cancel();
}

void DriveSetup::fail(Event trouble, std::uint32_t value) RT_SAFE {
  trouble_ = trouble;
  value_ = value;
  result_ = Result::kFailed;
}

void DriveSetup::finish_step() RT_SAFE {
  const Step& step = steps_[at_];
  switch (sdo_.result()) {
    case SdoClient::Result::kTimedOut:
      if (++tries_ >= kTries) fail(Event::kSdoTimeout, static_cast<std::uint32_t>(step.index));
      break;  // the step again
    case SdoClient::Result::kToggle:
      fail(Event::kSdoToggle, step.index);
      break;
    case SdoClient::Result::kAborted:
      if (step.kind == Kind::kName) {  // an optional object
        ++at_;
      } else {
        fail(Event::kSdoAbort, static_cast<std::uint32_t>(sdo_.abort_code()));
      }
      break;
    case SdoClient::Result::kDone: {
      tries_ = 0;
      const std::uint32_t value = sdo_.value();
      if (step.kind == Kind::kName) {
        const auto n =
            std::min<std::size_t>(sizeof device_name_ - 1, static_cast<std::size_t>(sdo_.size()));
        // Written only where it changes: the log's thread may be reading the same drive's name.
        if (std::memcmp(device_name_, sdo_.data(), n) != 0 || device_name_[n] != '\0') {
          std::memcpy(device_name_, sdo_.data(), n);
          device_name_[n] = '\0';
        }
      }
      const bool wrong = (step.kind == Kind::kExpect && step.value != 0 && value != step.value) ||
                         (step.kind == Kind::kMode && (value & step.value) == 0);
      if (wrong) return fail(step.trouble, value);
      ++at_;
      break;
    }
    default:
      break;
  }
  sdo_.cancel();
}

int DriveSetup::transmit(TimeNs now, Frame* out) RT_SAFE {
  int frames = 0;
  if (result_ == Result::kRunning) {
    if (sdo_.result() != SdoClient::Result::kBusy && sdo_.result() != SdoClient::Result::kIdle) {
      // The abort after a time-out or toggle error leaves before the next request.
      if (sdo_.next_frame(now, out[frames])) ++frames;
      finish_step();
    }
    if (result_ == Result::kRunning && sdo_.result() == SdoClient::Result::kIdle) {
      if (at_ == steps_.size()) {
        result_ = Result::kDone;
      } else {
        const Step& step = steps_[at_];
        if (step.kind == Kind::kNmt) {
          Frame& frame = out[frames++];
          frame = {};
          frame.id = cob::kNmt;
          frame.length = 2;
          frame.data[0] = static_cast<std::uint8_t>(step.value);
          frame.data[1] = static_cast<std::uint8_t>(node_);
          ++at_;
          return frames;
        }
        if (step.kind == Kind::kWrite) {
          (void)sdo_.write(step.index, step.sub, step.bytes, step.value);
        } else {
          (void)sdo_.read(step.index, step.sub);
        }
      }
    }
  }
  if (frames < 2 && sdo_.next_frame(now, out[frames])) ++frames;
  return frames;
}

}  // namespace wb::can
