// The conformance suite of the driver ABI, for anybody's plugin. Each check runs in a process of
// its own on a fresh instance, so that a plugin that crashes or hangs fails one check with that
// reason. Plugins that can step run on a virtual clock, so their result is repeatable; others run
// in real time against whatever their configuration connects to. Joints move a little: let them
// move freely.
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace wb::check {

struct Options {
  std::filesystem::path library;
  std::string config;            // text of the plugin's YAML section, without 'check'
  std::filesystem::path folder;  // what its file names are relative to
  std::string only;              // of the checks, beside the interface's; empty: all
  // From the file's optional section 'check'.
  double motion_tolerance = 2e-3;  // rad or m: encoder noise of a joint that stands still
  double rate_hz = 400;            // of read and write
  double timeout_ms = 100;         // given to activate
  double start_s = 5;              // within which every joint has to be measured after configure
  // Gains of the impedance commands; 0: from effort_max, full effort at 1 rad or 1 m.
  double stiffness = 0, damping = 0;

  // A plugin's configuration file: the text that its create() gets, and the section 'check'. Throws
  // config::ConfigError.
  static Options load(const std::filesystem::path& library, const std::filesystem::path& file);
};

enum class Outcome { kPassed, kFailed, kSkipped };

struct Result {
  std::string name;
  std::string proves;  // one sentence
  Outcome outcome = Outcome::kPassed;
  std::string reason;  // of a failure or a skip; of a pass: what was measured, or empty
};

// All checks in order. After a failed "interface" the others are skipped. Throws std::runtime_error
// if the library cannot be loaded at all.
std::vector<Result> run(const Options& options);

bool conforms(const std::vector<Result>& results);  // none failed

}  // namespace wb::check
