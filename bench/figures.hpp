// A bench's figures: the array of {"name", "value", "unit", "bound", "better"} that --json asks
// for, and the same as a table. Setup world. Units are the figure's own; times are equivalent times
// (DEFINITIONS.md) unless the unit says otherwise.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace wb::bench {

enum class Better { kLower, kHigher };

struct Figure {
  std::string name;
  double value = 0;
  std::string unit;
  std::optional<double> bound;  // inclusive
  Better better = Better::kLower;

  // A value that is not a number keeps no bound.
  bool holds() const {
    return !bound || (better == Better::kLower ? value <= *bound : value >= *bound);
  }
};

inline bool all_hold(const std::vector<Figure>& figures) {
  return std::all_of(figures.begin(), figures.end(), [](const Figure& f) { return f.holds(); });
}

// Throws std::runtime_error if the file cannot be written.
inline void write_json(const std::vector<Figure>& figures, const std::string& file) {
  const auto number = [](double v) {
    std::ostringstream out;
    out << v;
    return std::isfinite(v) ? out.str() : "null";
  };
  std::ofstream out(file);
  out << "[";
  for (std::size_t i = 0; i < figures.size(); ++i) {
    const Figure& f = figures[i];
    out << (i ? ",\n " : "\n ") << "{\"name\": \"" << f.name << "\", \"value\": " << number(f.value)
        << ", \"unit\": \"" << f.unit << "\", \"bound\": " << (f.bound ? number(*f.bound) : "null")
        << ", \"better\": \"" << (f.better == Better::kLower ? "lower" : "higher") << "\"}";
  }
  out << "\n]\n";
  out.close();
  if (!out) throw std::runtime_error(file + " cannot be written");
}

inline void print_table(const std::vector<Figure>& figures) {
  std::printf("%-28s %10s %-8s %10s\n", "figure", "value", "unit", "bound");
  for (const Figure& f : figures) {
    char bound[32] = "-";
    if (f.bound)
      std::snprintf(bound, sizeof bound, "%s %.4g",
                    f.better == Better::kLower ? "<=" : ">=", *f.bound);
    std::printf("%-28s %10.4g %-8s %10s%s\n", f.name.c_str(), f.value, f.unit.c_str(), bound,
                f.holds() ? "" : "  BROKEN");
  }
}

}  // namespace wb::bench
