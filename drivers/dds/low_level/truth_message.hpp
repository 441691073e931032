// LowLevel::Truth as a message; the message refers to storage of this object. World: job.
#pragma once
#include <array>

#include "drivers/dds/low_level/low_level.hpp"
#include "drivers/dds/messages.hpp"

namespace wb::dds {

class TruthMessage {
 public:
  // offset_ns: the robot's clock less the host's.
  TruthMessage(const LowLevel::Truth& truth, TimeNs offset_ns);
  TruthMessage(const TruthMessage&) = delete;
  TruthMessage& operator=(const TruthMessage&) = delete;
  msg::Truth& get() { return message_; }

 private:
  msg::Truth message_{};
  std::array<msg::TruthObject, 32> objects_{};
  std::array<msg::TruthContact, 64> contacts_{};
  std::array<msg::TruthLink, 64> links_{};
};

}  // namespace wb::dds
