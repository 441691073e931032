// Strict YAML loader. Setup world: throws ConfigError naming file, line, key, value and what was
// allowed. Every key of a section must be read before finish() is called on it; an unread key is an
// error with a "did you mean".
#pragma once
#include <yaml-cpp/yaml.h>

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <limits>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace wb::config {

class ConfigError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Range {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
};
inline constexpr Range kAny{};
inline constexpr Range kNonNegative{0.0};
inline constexpr Range kPositive{std::numeric_limits<double>::min()};
inline constexpr Range kFraction{0.0, 1.0};

// One mapping of the file. Copies share the record of the keys that were read.
class Section {
 public:
  // Opens the file and returns its root mapping.
  static Section open(const std::filesystem::path& file);
  // Same for text in memory; `name` stands for the file in errors.
  static Section parse(const std::string& text, const std::string& name);

  bool has(const std::string& key) const;
  bool is_scalar(const std::string& key) const;  // present, and a single value
  double number(const std::string& key, Range range = kAny) const;
  double number_or(const std::string& key, double otherwise, Range range = kAny) const;
  int integer(const std::string& key, Range range = kAny) const;
  bool boolean(const std::string& key) const;
  bool boolean_or(const std::string& key, bool otherwise) const;
  std::string text(const std::string& key) const;
  std::string text_or(const std::string& key, const std::string& otherwise) const;
  std::string one_of(const std::string& key, const std::vector<std::string>& allowed) const;
  std::vector<double> numbers(const std::string& key, int count = -1, Range range = kAny) const;
  Eigen::Vector3d vector3(const std::string& key) const;
  std::vector<std::string> texts(const std::string& key) const;
  std::vector<std::array<std::string, 2>> text_pairs(const std::string& key) const;
  Section section(const std::string& key) const;
  std::vector<Section> sections(const std::string& key) const;  // a sequence of mappings
  std::string block(
      const std::string& key) const;  // a mapping as YAML text, for whoever reads it (a plugin)
  std::vector<std::string> keys() const;

  // A file named by a key, relative to this file's folder; must exist.
  std::filesystem::path file(const std::string& key) const;
  const std::filesystem::path& path() const { return file_; }

  // Throws if a key was never asked for.
  void finish() const;
  // An error at this key, for checks that the callers make themselves.
  [[noreturn]] void fail(const std::string& key, const std::string& message) const;

 private:
  Section(std::filesystem::path file, std::string name, YAML::Node node);
  YAML::Node find(const std::string& key) const;
  double convert(const YAML::Node& node, const std::string& key, Range range) const;

  std::filesystem::path file_;
  std::string name_;  // dotted path within the file
  YAML::Node node_;
  std::shared_ptr<std::set<std::string>> read_;
};

}  // namespace wb::config
