#include "daemon/json.hpp"

#include <array>
#include <charconv>
#include <cmath>

namespace wb {

std::string Json::quote(std::string_view text) {
  static constexpr char kHex[] = "0123456789abcdef";
  std::string out = "\"";
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (code < 0x20 || code == 0x7f) {
      out += "\\u00";
      out += kHex[code >> 4];
      out += kHex[code & 15];
    } else {
      out += c;
    }
  }
  return out + '"';
}

std::string Json::format(double number) {
  if (!std::isfinite(number)) return "null";
  std::array<char, 32> digits{};  // the longest shortest form of a double has 24 characters
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), number).ptr;
  return {digits.data(), end};
}

Json& Json::item(const std::string& value) {
  if (text_.size() > 1) text_ += ", ";
  text_ += value;
  return *this;
}

}  // namespace wb
