// SDO server of a simulated drive: expedited and segmented, upload and download, one transfer at a
// time. Port world, no allocation. What a write means is the owner's `written`; CiA 301, 7.2.4.
#pragma once
#include <array>
#include <cstdint>

#include "drivers/can/can_frame.hpp"
#include "drivers/can/node/object_dictionary.hpp"

namespace wb::can {

class SdoServer {
 public:
  // What the owner says to a checked write: kNone takes it (the server then stores the value).
  using Written = SdoAbort (*)(void* owner, const Object& object, std::uint64_t value) noexcept;

  SdoServer(ObjectDictionary& objects, void* owner, Written written)
      : objects_(objects), owner_(owner), written_(written) {}

  // Answers one request (8 bytes); false: nothing to say.
  bool answer(const std::array<std::uint8_t, 8>& request, std::array<std::uint8_t, 8>& reply,
              bool wrong_toggle) noexcept;
  void reset() noexcept { transfer_ = Transfer::kNone; }

 private:
  enum class Transfer { kNone, kUpload, kDownload };
  bool abort(std::array<std::uint8_t, 8>& reply, SdoAbort code) noexcept;
  bool store(Object& object, std::uint64_t value, std::array<std::uint8_t, 8>& reply,
             std::uint8_t command) noexcept;

  ObjectDictionary& objects_;
  void* owner_;
  Written written_;
  Transfer transfer_ = Transfer::kNone;
  std::uint16_t index_ = 0;
  std::uint8_t sub_ = 0;
  bool toggle_ = false;
  std::size_t at_ = 0, size_ = 0;
  std::array<std::uint8_t, 64> buffer_{};
};

}  // namespace wb::can
