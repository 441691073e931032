// Writes JSON text: an object or array built member by member. World: jobs. Numbers that JSON lacks
// (NaN, infinity) become null.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>

namespace wb {

class Json {
 public:
  static Json object() { return Json('{', '}'); }
  static Json array() { return Json('[', ']'); }

  // Members of an object.
  Json& add(std::string_view key, std::string_view text) { return member(key, quote(text)); }
  Json& add(std::string_view key, const char* text) { return add(key, std::string_view(text)); }
  Json& add(std::string_view key, double number) { return member(key, format(number)); }
  Json& add(std::string_view key, std::uint64_t n) { return member(key, std::to_string(n)); }
  Json& add(std::string_view key, std::int64_t n) { return member(key, std::to_string(n)); }
  Json& add(std::string_view key, bool yes) { return member(key, yes ? "true" : "false"); }
  Json& add(std::string_view key, int n) { return member(key, std::to_string(n)); }
  Json& add(std::string_view key, const Json& value) { return member(key, value.str()); }
  // Items of an array.
  Json& push(double number) { return item(format(number)); }
  Json& push(const Json& value) { return item(value.str()); }

  std::string str() const { return text_ + close_; }

 private:
  Json(char open, char close) : text_(1, open), close_(close) {}
  static std::string quote(std::string_view text);
  static std::string format(double number);
  Json& member(std::string_view key, const std::string& value) {
    return item(quote(key) + ": " + value);
  }
  Json& item(const std::string& value);

  std::string text_;
  char close_;
};

}  // namespace wb
