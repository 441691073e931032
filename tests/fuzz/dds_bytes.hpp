// A fuzzer's input as values, and what is made of them.
#pragma once
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace wb::dds {

inline void promise(bool kept, const char* what) {
  if (kept) return;
  std::fprintf(stderr, "broken promise: %s\n", what);
  std::abort();
}

// Zeros after the input's end.
class Bytes {
 public:
  Bytes(const std::uint8_t* data, std::size_t size) : data_(data), size_(size) {}
  template <class T>
  T take() {
    T value{};
    take(&value, sizeof value);
    return value;
  }
  bool flag() { return take<std::uint8_t>() & 1; }
  void take(void* to, std::size_t n) {
    const std::size_t have = std::min(n, size_);
    if (have > 0) std::memcpy(to, data_, have);
    data_ += have;
    size_ -= have;
  }
  std::size_t left() const { return size_; }
  const std::uint8_t* rest() const { return data_; }

 private:
  const std::uint8_t* data_;
  std::size_t size_;
};

// Changes up to seven bytes.
inline void flip(void* data, std::size_t size, Bytes& bytes) {
  auto* raw = static_cast<std::uint8_t*>(data);
  for (int n = bytes.take<std::uint8_t>() % 8; n > 0; --n) {
    const std::size_t at = bytes.take<std::uint16_t>();
    const auto by = bytes.take<std::uint8_t>();
    if (size > 0) raw[at % size] ^= by;
  }
}

}  // namespace wb::dds
