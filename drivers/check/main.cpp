// wb-driver-check PLUGIN.so --config FILE [--only CHECK] [--json]: the conformance suite as a
// program. Exit code 0: conforms, 1: does not, 2: could not be run.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "drivers/check/driver_check.hpp"

namespace {

using wb::check::Outcome;
using wb::check::Result;

const char* word(Outcome outcome) {
  return outcome == Outcome::kPassed   ? "passed"
         : outcome == Outcome::kFailed ? "FAILED"
                                       : "skipped";
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      out += '\\';
      out += c;
    } else if (static_cast<unsigned char>(c) < 0x20) {
      char code[8];
      std::snprintf(code, sizeof code, "\\u%04x", c);
      out += code;
    } else {
      out += c;
    }
  }
  return out + "\"";
}

void print_json(const std::vector<Result>& results) {
  std::printf("{\"conforms\": %s, \"checks\": [\n",
              wb::check::conforms(results) ? "true" : "false");
  for (std::size_t i = 0; i < results.size(); ++i) {
    const Result& r = results[i];
    std::printf("  {\"name\": %s, \"outcome\": %s, \"proves\": %s, \"reason\": %s}%s\n",
                quoted(r.name).c_str(), quoted(word(r.outcome)).c_str(), quoted(r.proves).c_str(),
                quoted(r.reason).c_str(), i + 1 < results.size() ? "," : "");
  }
  std::printf("]}\n");
}

void print_table(const std::vector<Result>& results) {
  int counts[3] = {};
  for (const Result& r : results) {
    ++counts[static_cast<int>(r.outcome)];
    std::printf("%-8s %-24s %s\n", word(r.outcome), r.name.c_str(), r.proves.c_str());
    if (!r.reason.empty()) std::printf("%-33s %s\n", "", r.reason.c_str());
  }
  std::printf("%d passed, %d failed, %d skipped\n", counts[0], counts[1], counts[2]);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Checks a driver plugin against drivers/driver.h (docs/how-to/add-a-driver.md).");
  std::string library, config, folder, only;
  double motion_tolerance = 0;
  bool json = false;
  app.add_option("plugin", library, "the plugin, a shared object")->required();
  app.add_option("--config", config,
                 "the plugin's configuration (YAML); its section 'check' is the suite's")
      ->required();
  app.add_option("--folder", folder, "what its file names are relative to (default: its folder)");
  app.add_option("--motion-tolerance", motion_tolerance,
                 "rad or m by which a joint at rest may seem to move (encoder noise)")
      ->check(CLI::PositiveNumber);
  app.add_option("--only", only, "one check by its name");
  app.add_flag("--json", json, "print the results as JSON");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    wb::check::Options options = wb::check::Options::load(library, config);
    if (!folder.empty()) options.folder = folder;
    if (motion_tolerance > 0) options.motion_tolerance = motion_tolerance;
    options.only = only;
    const std::vector<Result> results = wb::check::run(options);
    json ? print_json(results) : print_table(results);
    return wb::check::conforms(results) ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "wb-driver-check: %s\n", error.what());
    return 2;
  }
}
