// SdoClient: transfers with one drive's object dictionary, one at a time (CiA 301, 7.2.4):
// expedited writes, expedited and segmented reads, time-out, aborts by code, toggle check. Port
// world, no allocation: start, hand over answers, take requests from next_frame() until the result
// is no longer kBusy.
#pragma once
#include <array>
#include <cstdint>

#include "core/rt/rt_safe.hpp"
#include "core/types/time.hpp"
#include "drivers/can/can_frame.hpp"
#include "drivers/can/canopen/objects.hpp"

namespace wb::can {

class SdoClient {
 public:
  enum class Result : std::uint8_t { kIdle, kBusy, kDone, kAborted, kTimedOut, kToggle };

  SdoClient(int node_id, TimeNs timeout_ns) : node_(node_id), timeout_ns_(timeout_ns) {}

  // False while a transfer runs. bytes: 1 to 4.
  bool write(std::uint16_t index, std::uint8_t sub, int bytes, std::uint32_t value) RT_SAFE;
  bool read(std::uint16_t index, std::uint8_t sub) RT_SAFE;
  void received(const Frame& frame) RT_SAFE;
  // The request that is due, if there is one; also watches the time-out.
  bool next_frame(TimeNs now, Frame& frame) RT_SAFE;
  void cancel() RT_SAFE {
    result_ = Result::kIdle;
    due_ = false;
  }

  Result result() const { return result_; }
  SdoAbort abort_code() const { return abort_; }
  // Of a finished read.
  std::uint32_t value() const { return static_cast<std::uint32_t>(get_bytes(data_.data(), 4)); }
  const std::uint8_t* data() const { return data_.data(); }
  int size() const { return size_; }

 private:
  void start(std::uint8_t command, std::uint16_t index, std::uint8_t sub) RT_SAFE;
  void finish(Result result, SdoAbort abort) RT_SAFE;
  void ask_segment() RT_SAFE;

  int node_;
  TimeNs timeout_ns_;
  Result result_ = Result::kIdle;
  SdoAbort abort_ = SdoAbort::kNone;
  std::uint16_t index_ = 0;
  std::uint8_t sub_ = 0;
  bool reading_ = false, segmented_ = false, toggle_ = false;
  bool due_ = false;
  TimeNs deadline_ = 0;
  std::array<std::uint8_t, 8> request_{};
  std::array<std::uint8_t, 64> data_{};
  int size_ = 0;
};

}  // namespace wb::can
