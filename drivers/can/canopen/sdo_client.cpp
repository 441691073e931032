#include "drivers/can/canopen/sdo_client.hpp"

#include <algorithm>

namespace wb::can {

void SdoClient::start(std::uint8_t command, std::uint16_t index, std::uint8_t sub) RT_SAFE {
  index_ = index;
  sub_ = sub;
  request_ = {};
  request_[0] = command;
  put_bytes(&request_[1], 2, index);
  request_[3] = sub;
  result_ = Result::kBusy;
  abort_ = SdoAbort::kNone;
  segmented_ = toggle_ = false;
  due_ = true;
  size_ = 0;
  data_ = {};
}

bool SdoClient::write(std::uint16_t index, std::uint8_t sub, int bytes,
                      std::uint32_t value) RT_SAFE {
  if (result_ == Result::kBusy || bytes < 1 || bytes > 4) return false;
  reading_ = false;
  start(static_cast<std::uint8_t>(0x23 | (4 - bytes) << 2), index, sub);
  put_bytes(&request_[4], bytes, value);
  return true;
}

bool SdoClient::read(std::uint16_t index, std::uint8_t sub) RT_SAFE {
  if (result_ == Result::kBusy) return false;
  reading_ = true;
  start(0x40, index, sub);
  return true;
}

void SdoClient::finish(Result result, SdoAbort abort) RT_SAFE {
  result_ = result;
  abort_ = abort;
  due_ = false;
  if (result == Result::kTimedOut || result == Result::kToggle) {  // tell the drive
    request_ = {};
    request_[0] = 0x80;
    put_bytes(&request_[1], 2, index_);
    request_[3] = sub_;
    put_bytes(&request_[4], 4, static_cast<std::uint32_t>(abort));
    due_ = true;
  }
}

void SdoClient::ask_segment() RT_SAFE {
  request_ = {};
  request_[0] = static_cast<std::uint8_t>(0x60 | (toggle_ ? 0x10 : 0));
  due_ = true;
}

void SdoClient::received(const Frame& frame) RT_SAFE {
  // An answer before the request has left belongs to an older transfer.
  if (result_ != Result::kBusy || due_ || frame.length != 8) return;
  const auto& d = frame.data;
  const int command = d[0] >> 5;
  const bool same = get_bytes(&d[1], 2) == index_ && d[3] == sub_;
  if (command == 4) {
    if (same) finish(Result::kAborted, static_cast<SdoAbort>(get_bytes(&d[4], 4)));
    return;
  }
  if (!reading_) {
    if (command == 3 && same) finish(Result::kDone, SdoAbort::kNone);
    return;
  }
  if (!segmented_) {
    if (command != 2 || !same) return;
    if (d[0] & 2) {
      size_ = d[0] & 1 ? 4 - (d[0] >> 2 & 3) : 4;
      std::copy_n(d.begin() + 4, size_, data_.begin());
      return finish(Result::kDone, SdoAbort::kNone);
    }
    segmented_ = true;
    return ask_segment();
  }
  if (command != 0) return;
  if (((d[0] & 0x10) != 0) != toggle_) return finish(Result::kToggle, SdoAbort::kToggle);
  const int n = 7 - (d[0] >> 1 & 7);
  for (int i = 0; i < n && size_ < static_cast<int>(data_.size()); ++i)
    data_[static_cast<std::size_t>(size_++)] = d[static_cast<std::size_t>(i + 1)];
  if (d[0] & 1) return finish(Result::kDone, SdoAbort::kNone);
  toggle_ = !toggle_;
  ask_segment();
}

bool SdoClient::next_frame(TimeNs now, Frame& frame) RT_SAFE {
  if (result_ == Result::kBusy && !due_ && now >= deadline_)
    finish(Result::kTimedOut, SdoAbort::kTimeout);
  if (!due_) return false;
  due_ = false;
  deadline_ = now + timeout_ns_;
  frame = {};
  frame.id = cob::kSdoRequest + static_cast<std::uint32_t>(node_);
  frame.length = 8;
  frame.data = request_;
  return true;
}

}  // namespace wb::can
