#include "core/config/config.hpp"

#include <gtest/gtest.h>

namespace wb::config {
namespace {

std::string error_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "";
}

TEST(Config, NamesFileLineKeyValueAndRange) {
  const Section s = Section::parse("a: 1\nrate_hz: -5\n", "robot.yaml");
  const std::string e = error_of([&] { s.number("rate_hz", kPositive); });
  EXPECT_NE(e.find("robot.yaml:2"), std::string::npos) << e;
  EXPECT_NE(e.find("'rate_hz'"), std::string::npos) << e;
  EXPECT_NE(e.find("-5"), std::string::npos) << e;
  EXPECT_NE(e.find("allowed"), std::string::npos) << e;
}

TEST(Config, UnknownKeyIsAnErrorWithAGuess) {
  const Section s = Section::parse("tiemout_s: 1\n", "f");
  const std::string e = error_of([&] {
    s.number_or("timeout_s", 2.0);
    s.finish();
  });
  EXPECT_NE(e.find("unknown key 'tiemout_s'"), std::string::npos) << e;
  EXPECT_NE(e.find("did you mean 'timeout_s'"), std::string::npos) << e;
}

TEST(Config, MissingKeyIsAnErrorWithAGuess) {
  const Section s = Section::parse("tiemout_s: 1\n", "f");
  const std::string e = error_of([&] { s.number("timeout_s"); });
  EXPECT_NE(e.find("'timeout_s' is missing"), std::string::npos) << e;
  EXPECT_NE(e.find("tiemout_s"), std::string::npos) << e;
}

TEST(Config, WrongTypesSizesNotANumberAndTwiceAreErrors) {
  const Section s = Section::parse("a: text\nb: [1, 2]\nc: .nan\nd: 1.5\ne: perhaps\n", "f");
  EXPECT_THROW(s.number("a"), ConfigError);
  EXPECT_THROW(s.numbers("b", 3), ConfigError);
  EXPECT_THROW(s.number("c"), ConfigError);
  EXPECT_THROW(s.integer("d"), ConfigError);
  EXPECT_THROW(s.boolean("e"), ConfigError);
  EXPECT_THROW(s.section("a"), ConfigError);
  EXPECT_THROW(Section::parse("a: 1\na: 2\n", "f"), ConfigError);
  EXPECT_THROW(Section::parse("a: [1\n", "f"), ConfigError);
  EXPECT_THROW(Section::open("/nowhere/at/all.yaml"), ConfigError);
}

TEST(Config, NestedSectionsNameTheirPath) {
  const Section s = Section::parse("outer:\n  inner:\n    x: 1\n", "f");
  const std::string e = error_of([&] { s.section("outer").section("inner").text("y"); });
  EXPECT_NE(e.find("'outer.inner.y'"), std::string::npos) << e;
}

}  // namespace
}  // namespace wb::config
