#include "core/config/config.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "core/config/closest.hpp"

namespace wb::config {
namespace {

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1])});
      diagonal = above;
    }
  }
  return row[b.size()];
}

std::string where(const std::filesystem::path& file, const YAML::Node& node) {
  std::ostringstream out;
  out << file.string();
  if (node.IsDefined() && node.Mark().line >= 0) out << ":" << node.Mark().line + 1;
  return out.str();
}

std::string scalar(const YAML::Node& node) {
  return node.IsScalar() ? node.Scalar() : "not a single value";
}

}  // namespace

std::string closest(const std::string& word, const std::vector<std::string>& candidates) {
  std::string best;
  std::size_t best_distance = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string& c : candidates) {
    if (const std::size_t d = edit_distance(word, c); d < best_distance) {
      best_distance = d;
      best = c;
    }
  }
  return best;
}

Section::Section(std::filesystem::path file, std::string name, YAML::Node node)
    : file_(std::move(file)),
      name_(std::move(name)),
      node_(std::move(node)),
      read_(std::make_shared<std::set<std::string>>()) {
  if (!node_.IsMap()) {
    throw ConfigError(where(file_, node_) + ": " +
                      (name_.empty() ? "the file" : "'" + name_ + "'") +
                      " must be a mapping of keys to values");
  }
  std::set<std::string> seen;
  for (const auto& entry : node_) {
    if (!seen.insert(entry.first.Scalar()).second) {
      throw ConfigError(where(file_, entry.first) + ": key '" + entry.first.Scalar() +
                        "' stands twice");
    }
  }
}

Section Section::open(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw ConfigError(file.string() + ": cannot be opened");
  std::ostringstream text;
  text << in.rdbuf();
  return parse(text.str(), file.string());
}

Section Section::parse(const std::string& text, const std::string& name) {
  try {
    return {name, "", YAML::Load(text)};
  } catch (const YAML::ParserException& e) {
    throw ConfigError(name + ":" + std::to_string(e.mark.line + 1) + ": " + e.msg);
  }
}

void Section::fail(const std::string& key, const std::string& message) const {
  const YAML::Node n = node_[key];
  throw ConfigError(where(file_, n.IsDefined() ? n : node_) + ": '" +
                    (name_.empty() ? key : name_ + "." + key) + "' " + message);
}

YAML::Node Section::find(const std::string& key) const {
  read_->insert(key);
  const YAML::Node n = node_[key];
  if (!n.IsDefined()) {
    std::vector<std::string> unread;
    for (const std::string& k : keys()) {
      if (!read_->contains(k)) unread.push_back(k);
    }
    const std::string guess = closest(key, unread);
    fail(key, "is missing" + (guess.empty() ? "" : "; did you mean it with '" + guess + "'?"));
  }
  return n;
}

double Section::convert(const YAML::Node& n, const std::string& key, Range range) const {
  double value = 0;
  try {
    value = n.as<double>();
  } catch (const YAML::Exception&) {
    fail(key, "must be a number, is '" + scalar(n) + "'");
  }
  if (std::isnan(value) || value < range.low || value > range.high) {
    std::ostringstream out;
    out << "is " << value << ", allowed: " << range.low << " to " << range.high;
    fail(key, out.str());
  }
  return value;
}

bool Section::has(const std::string& key) const { return node_[key].IsDefined(); }
bool Section::is_scalar(const std::string& key) const { return has(key) && node_[key].IsScalar(); }
double Section::number(const std::string& key, Range range) const {
  return convert(find(key), key, range);
}
double Section::number_or(const std::string& key, double otherwise, Range range) const {
  read_->insert(key);
  return has(key) ? number(key, range) : otherwise;
}

int Section::integer(const std::string& key, Range range) const {
  const double value = number(key, range);
  if (value != std::floor(value) || std::abs(value) > 2e9) fail(key, "must be a whole number");
  return static_cast<int>(value);
}

bool Section::boolean(const std::string& key) const {
  const YAML::Node n = find(key);
  try {
    return n.as<bool>();
  } catch (const YAML::Exception&) {
    fail(key, "must be true or false, is '" + scalar(n) + "'");
  }
}
bool Section::boolean_or(const std::string& key, bool otherwise) const {
  read_->insert(key);
  return has(key) ? boolean(key) : otherwise;
}

std::string Section::text(const std::string& key) const {
  const YAML::Node n = find(key);
  if (!n.IsScalar()) fail(key, "must be a text");
  return n.Scalar();
}
std::string Section::text_or(const std::string& key, const std::string& otherwise) const {
  read_->insert(key);
  return has(key) ? text(key) : otherwise;
}

std::string Section::one_of(const std::string& key, const std::vector<std::string>& allowed) const {
  const std::string value = text(key);
  if (std::find(allowed.begin(), allowed.end(), value) == allowed.end()) {
    std::string list;
    for (const std::string& a : allowed) list += (list.empty() ? "" : ", ") + a;
    const std::string guess = closest(value, allowed);
    fail(key, "is '" + value + "', allowed: " + list +
                  (guess.empty() ? "" : "; did you mean '" + guess + "'?"));
  }
  return value;
}

std::vector<double> Section::numbers(const std::string& key, int count, Range range) const {
  const YAML::Node n = find(key);
  if (!n.IsSequence()) fail(key, "must be a list of numbers");
  if (count >= 0 && static_cast<int>(n.size()) != count) {
    fail(key, "must hold " + std::to_string(count) + " numbers, holds " + std::to_string(n.size()));
  }
  std::vector<double> out;
  for (const auto& element : n) out.push_back(convert(element, key, range));
  return out;
}

Eigen::Vector3d Section::vector3(const std::string& key) const {
  const std::vector<double> v = numbers(key, 3);
  return {v[0], v[1], v[2]};
}

std::vector<std::string> Section::texts(const std::string& key) const {
  const YAML::Node n = find(key);
  if (!n.IsSequence()) fail(key, "must be a list");
  std::vector<std::string> out;
  for (const auto& element : n) {
    if (!element.IsScalar()) fail(key, "must be a list of texts");
    out.push_back(element.Scalar());
  }
  return out;
}

std::vector<std::array<std::string, 2>> Section::text_pairs(const std::string& key) const {
  const YAML::Node n = find(key);
  if (!n.IsSequence()) fail(key, "must be a list of pairs");
  std::vector<std::array<std::string, 2>> out;
  for (const auto& pair : n) {
    if (!pair.IsSequence() || pair.size() != 2 || !pair[0].IsScalar() || !pair[1].IsScalar()) {
      fail(key, "must be a list of pairs of texts");
    }
    out.push_back({pair[0].Scalar(), pair[1].Scalar()});
  }
  return out;
}

Section Section::section(const std::string& key) const {
  return {file_, name_.empty() ? key : name_ + "." + key, find(key)};
}

std::vector<Section> Section::sections(const std::string& key) const {
  const YAML::Node n = find(key);
  if (!n.IsSequence()) fail(key, "must be a list of mappings");
  std::vector<Section> out;
  for (std::size_t i = 0; i < n.size(); ++i) {
    out.push_back(
        {file_, (name_.empty() ? key : name_ + "." + key) + "[" + std::to_string(i) + "]", n[i]});
  }
  return out;
}

std::string Section::block(const std::string& key) const {
  const YAML::Node n = find(key);
  if (!n.IsMap()) fail(key, "must be a mapping of keys to values");
  return YAML::Dump(n);
}

std::vector<std::string> Section::keys() const {
  std::vector<std::string> out;
  for (const auto& entry : node_) out.push_back(entry.first.Scalar());
  return out;
}

std::filesystem::path Section::file(const std::string& key) const {
  const std::filesystem::path p = file_.parent_path() / text(key);
  if (!std::filesystem::exists(p)) fail(key, "names a file that does not exist: " + p.string());
  return p;
}

void Section::finish() const {
  for (const auto& entry : node_) {
    const std::string key = entry.first.Scalar();
    if (read_->contains(key)) continue;
    const std::string guess = closest(key, {read_->begin(), read_->end()});
    throw ConfigError(where(file_, entry.first) + ": unknown key '" +
                      (name_.empty() ? key : name_ + "." + key) + "'" +
                      (guess.empty() ? "" : "; did you mean '" + guess + "'?"));
  }
}

}  // namespace wb::config
