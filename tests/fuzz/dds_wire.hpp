// A message through Cyclone's own serialiser and back, with bytes of it changed or cut off on the
// way, as a reader gets it from a broken or hostile peer. Cyclone's stream functions are internal
// to it: for the fuzzer only.
#pragma once
#include <dds/ddsi/ddsi_cdrstream.h>
#include <dds/ddsi/ddsi_serdata_default.h>

#include "idl/dds.hpp"
#include "tests/fuzz/dds_bytes.hpp"

namespace wb::dds {

template <class Message>
class Wired {
 public:
  Wired(const Message& good, Bytes& bytes) {
    dds_ostream_t out{};
    dds_ostream_init(&out, 0, kXcdr1);
    if (dds_stream_write(&out, reinterpret_cast<const char*>(&good), ops())) {
      auto* cdr = reinterpret_cast<char*>(out.m_buffer);
      std::uint32_t size = out.m_index, used = 0;
      flip(cdr, size, bytes);
      if (bytes.flag()) size -= std::min<std::uint32_t>(size, bytes.take<std::uint16_t>() % 64);
      taken_ = dds_stream_normalize_data(cdr, &used, size, false, kXcdr1, ops()) != nullptr;
      if (taken_) {
        ddsi_sertype_default type{};
        type.type.ops.ops = const_cast<std::uint32_t*>(ops());
        dds_istream_t in{};
        dds_istream_init(&in, size, cdr, kXcdr1);
        dds_stream_read_sample(&in, &message_, &type);
      }
    }
    dds_ostream_fini(&out);
  }
  ~Wired() { dds_stream_free_sample(&message_, ops()); }
  Wired(const Wired&) = delete;
  Wired& operator=(const Wired&) = delete;

  bool taken() const { return taken_; }  // by Cyclone
  const Message& message() const { return message_; }

 private:
  static constexpr std::uint32_t kXcdr1 = 1;
  static const std::uint32_t* ops() { return descriptor<Message>()->m_ops; }
  Message message_{};
  bool taken_ = false;
};

}  // namespace wb::dds
