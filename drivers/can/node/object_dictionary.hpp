// The objects of a simulated drive: number, width, access, value. Setup adds, ports read and write.
// Fixed storage, no allocation after construction. Multi-byte values little endian in a uint64.
#pragma once
#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/can/canopen/objects.hpp"

namespace wb::can {

struct Object {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  std::uint8_t bytes = 4;  // 0: a text
  bool writable = false;
  std::uint64_t value = 0;
};

class ObjectDictionary {
 public:
  void add(std::uint16_t index, std::uint8_t sub, int bytes, bool writable, std::uint64_t value) {
    objects_.push_back({index, sub, static_cast<std::uint8_t>(bytes), writable, value});
  }
  void add_text(std::uint16_t index, std::string text) {
    objects_.push_back({index, 0, 0, false, 0});
    text_ = std::move(text);
  }
  Object* find(std::uint16_t index, std::uint8_t sub) noexcept {
    for (Object& o : objects_) {
      if (o.index == index && o.sub == sub) return &o;
    }
    return nullptr;
  }
  bool has_index(std::uint16_t index) const noexcept {
    return std::any_of(objects_.begin(), objects_.end(),
                       [&](const Object& o) { return o.index == index; });
  }
  std::uint64_t get(std::uint16_t index, std::uint8_t sub) const noexcept {
    for (const Object& o : objects_) {
      if (o.index == index && o.sub == sub) return o.value;
    }
    return 0;
  }
  void set(std::uint16_t index, std::uint8_t sub, std::uint64_t value) noexcept {
    if (Object* o = find(index, sub)) o->value = value;
  }
  const std::string& text() const { return text_; }

 private:
  std::vector<Object> objects_;
  std::string text_;
};

}  // namespace wb::can
