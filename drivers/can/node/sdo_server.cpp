#include "drivers/can/node/sdo_server.hpp"

#include <algorithm>

namespace wb::can {
namespace {

using Data = std::array<std::uint8_t, 8>;

void start(Data& reply, std::uint8_t command, std::uint16_t index, std::uint8_t sub) noexcept {
  reply = {};
  reply[0] = command;
  put_bytes(&reply[1], 2, index);
  reply[3] = sub;
}

}  // namespace

bool SdoServer::abort(Data& reply, SdoAbort code) noexcept {
  start(reply, 0x80, index_, sub_);
  put_bytes(&reply[4], 4, static_cast<std::uint32_t>(code));
  transfer_ = Transfer::kNone;
  return true;
}

bool SdoServer::store(Object& object, std::uint64_t value, Data& reply,
                      std::uint8_t command) noexcept {
  const SdoAbort verdict = written_(owner_, object, value);
  if (verdict != SdoAbort::kNone) return abort(reply, verdict);
  object.value = value;
  transfer_ = Transfer::kNone;
  start(reply, command, index_, sub_);
  if (command != 0x60) reply = Data{command};
  return true;
}

bool SdoServer::answer(const Data& request, Data& reply, bool wrong_toggle) noexcept {
  const int command = request[0] >> 5;
  const bool toggle = (request[0] & 0x10) != 0;
  if (command == 4) {  // the client gives up
    transfer_ = Transfer::kNone;
    return false;
  }
  if (command == 1 || command == 2) {  // initiate download, upload
    index_ = static_cast<std::uint16_t>(get_bytes(&request[1], 2));
    sub_ = request[3];
    Object* object = objects_.find(index_, sub_);
    if (!object)
      return abort(reply, objects_.has_index(index_) ? SdoAbort::kNoSubindex : SdoAbort::kNoObject);
    toggle_ = false;
    at_ = 0;
    if (command == 1) {
      if (!object->writable) return abort(reply, SdoAbort::kReadOnly);
      const bool expedited = request[0] & 2, sized = request[0] & 1;
      if (!expedited) {
        size_ = sized ? get_bytes(&request[4], 4) : object->bytes;
        if (size_ != object->bytes) return abort(reply, SdoAbort::kLength);
        transfer_ = Transfer::kDownload;
        start(reply, 0x60, index_, sub_);
        return true;
      }
      const int bytes = sized ? 4 - (request[0] >> 2 & 3) : object->bytes;
      if (bytes != object->bytes) return abort(reply, SdoAbort::kLength);
      return store(*object, get_bytes(&request[4], bytes), reply, 0x60);
    }
    if (object->bytes > 0 && object->bytes <= 4) {
      start(reply, static_cast<std::uint8_t>(0x43 | (4 - object->bytes) << 2), index_, sub_);
      put_bytes(&reply[4], object->bytes, object->value);
      transfer_ = Transfer::kNone;
      return true;
    }
    if (object->bytes == 0) {
      size_ = std::min(objects_.text().size(), buffer_.size());
      std::copy_n(objects_.text().begin(), size_, buffer_.begin());
    } else {
      size_ = object->bytes;
      put_bytes(buffer_.data(), object->bytes, object->value);
    }
    transfer_ = Transfer::kUpload;
    start(reply, 0x41, index_, sub_);
    put_bytes(&reply[4], 4, size_);
    return true;
  }
  const bool expected = command == 3 ? transfer_ == Transfer::kUpload
                                     : command == 0 && transfer_ == Transfer::kDownload;
  if (!expected) return abort(reply, SdoAbort::kCommand);
  if (toggle != toggle_) return abort(reply, SdoAbort::kToggle);
  const std::uint8_t sent_toggle = (toggle != wrong_toggle) ? 0x10 : 0x00;
  toggle_ = !toggle_;
  if (command == 3) {  // upload segment
    const std::size_t n = std::min<std::size_t>(7, size_ - at_);
    const bool last = at_ + n == size_;
    reply = {};
    reply[0] = static_cast<std::uint8_t>(sent_toggle | (7 - n) << 1 | (last ? 1 : 0));
    std::copy_n(buffer_.begin() + static_cast<std::ptrdiff_t>(at_), n, reply.begin() + 1);
    at_ += n;
    if (last) transfer_ = Transfer::kNone;
    return true;
  }
  const std::size_t n = 7 - (request[0] >> 1 & 7u);  // download segment
  if (at_ + n > size_) return abort(reply, SdoAbort::kLength);
  std::copy_n(request.begin() + 1, n, buffer_.begin() + static_cast<std::ptrdiff_t>(at_));
  at_ += n;
  const auto acknowledge = static_cast<std::uint8_t>(0x20 | sent_toggle);
  if ((request[0] & 1) == 0) {
    reply = Data{acknowledge};
    return true;
  }
  Object* object = objects_.find(index_, sub_);
  if (!object || at_ != size_) return abort(reply, SdoAbort::kLength);
  return store(*object, get_bytes(buffer_.data(), object->bytes), reply, acknowledge);
}

}  // namespace wb::can
