// DriveSetup: brings one drive from "somebody answers" to process data running: identity,
// supported modes, heartbeats both ways, what the drive does when the master dies, mode, PDO
// mapping in the mandated order with read-back (PDO off, count 0, entries, count, PDO on), NMT
// start. Port world: advances by one SDO transfer a cycle, never waits. CiA 301 7.5.2, CiA 402.
#pragma once
#include <vector>

#include "drivers/can/canopen/sdo_client.hpp"
#include "drivers/can/drive_config.hpp"
#include "drivers/can/events.hpp"

namespace wb::can {

class DriveSetup {
 public:
  enum class Result : std::uint8_t { kRunning, kDone, kFailed };

  DriveSetup(const DriveConfig& drive, const Supervision& supervision);

  void restart() RT_SAFE;
  // Also writes one object after setup (0x605A): false while the client is busy.
  SdoClient& sdo() { return sdo_; }
  // One cycle; writes at most two frames. After kFailed, trouble() and value() say why.
  int transmit(TimeNs now, Frame* out) RT_SAFE;
  Result result() const { return result_; }
  Event trouble() const { return trouble_; }
  std::uint32_t value() const { return value_; }
  const char* device_name() const { return device_name_; }

 private:
  enum class Kind : std::uint8_t { kNmt, kWrite, kExpect, kMode, kName };
  struct Step {
    Kind kind;
    std::uint16_t index = 0;
    std::uint8_t sub = 0;
    std::uint8_t bytes = 0;
    std::uint32_t value = 0;
    Event trouble = Event::kSdoAbort;  // where the answer is another
  };
  void write(std::uint16_t index, int sub, int bytes, std::uint32_t value);
  void expect(std::uint16_t index, int sub, std::uint32_t value, Event trouble);
  void map(std::uint16_t parameters, std::uint32_t cob_id, std::uint32_t type,
           const std::vector<std::uint32_t>& entries);
  void finish_step() RT_SAFE;
  void fail(Event trouble, std::uint32_t value) RT_SAFE;

  static constexpr int kTries = 3;  // of a step that nobody answers
  std::vector<Step> steps_;
  SdoClient sdo_;
  int node_;
  std::size_t at_ = 0;
  int tries_ = 0;
  Result result_ = Result::kRunning;
  Event trouble_ = Event::kSdoTimeout;
  std::uint32_t value_ = 0;
  char device_name_[32] = {};
};

}  // namespace wb::can
