#include "drivers/check/driver_check.hpp"

#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

#include "core/config/config.hpp"
#include "drivers/check/checks.hpp"

namespace wb::check {
namespace {

constexpr int kPatienceMs = 120'000;  // of one check; only one that hangs takes so long

// In the child: the check's outcome as one byte, then its reason.
std::string perform(const Check& check, const Options& options) {
  std::string text = "p";
  try {
    text += check.run(options);
  } catch (const Failed& f) {
    text = 'f';
    text += f.reason;
  } catch (const Skipped& s) {
    text = 's';
    text += s.reason;
  } catch (const std::exception& error) {
    text = 'f';
    text += error.what();
  }
  return text;
}

std::string read_all(int fd, bool& hung) {
  std::string out;
  char buffer[1024];
  pollfd p{fd, POLLIN, 0};
  for (;;) {
    const int ready = poll(&p, 1, kPatienceMs);
    if (ready < 0 && errno == EINTR) continue;
    hung = ready == 0;
    const ssize_t n = ready > 0 ? read(fd, buffer, sizeof buffer) : 0;
    if (n <= 0) return out;
    out.append(buffer, static_cast<std::size_t>(n));
  }
}

// Whether it loads at all, in a child, too: this process never runs the plugin's code.
std::string load(const Options& options) {
  Library library(options.library);
  return "";
}

}  // namespace

Result in_child(const Check& check, const Options& options) {
  Result result{check.name, check.proves, Outcome::kFailed, ""};
  int ends[2];
  if (pipe(ends) != 0) throw std::runtime_error(std::strerror(errno));
  const pid_t child = fork();
  if (child < 0) throw std::runtime_error(std::strerror(errno));
  if (child == 0) {
    close(ends[0]);
    const std::string text = perform(check, options);
    std::size_t sent = 0;
    while (sent < text.size()) {
      const ssize_t n = write(ends[1], text.data() + sent, text.size() - sent);
      if (n <= 0) _exit(1);
      sent += static_cast<std::size_t>(n);
    }
    _exit(0);
  }
  close(ends[1]);
  bool hung = false;
  const std::string text = read_all(ends[0], hung);
  close(ends[0]);
  if (hung) kill(child, SIGKILL);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (hung) {
    result.reason = "did not end within " + std::to_string(kPatienceMs / 1000) + " s";
  } else if (WIFSIGNALED(status)) {
    result.reason = std::string("crashed: ") + strsignal(WTERMSIG(status));
  } else if (text.empty()) {
    result.reason = "ended without a result, exit code " + std::to_string(WEXITSTATUS(status));
  } else {
    result.outcome = text[0] == 'p'   ? Outcome::kPassed
                     : text[0] == 's' ? Outcome::kSkipped
                                      : Outcome::kFailed;
    result.reason = text.substr(1);
  }
  return result;
}

Options Options::load(const std::filesystem::path& library, const std::filesystem::path& file) {
  Options out;
  out.library = library;
  out.folder = file.parent_path();
  std::ifstream in(file);
  if (!in) throw config::ConfigError(file.string() + ": cannot be read");
  std::ostringstream text;
  text << in.rdbuf();
  out.config = text.str();
  const config::Section root = config::Section::parse(out.config, file.string());
  if (!root.has("check")) return out;
  const config::Section s = root.section("check");
  out.motion_tolerance = s.number_or("motion_tolerance", out.motion_tolerance, config::kPositive);
  out.rate_hz = s.number_or("rate_hz", out.rate_hz, {10, 10'000});
  out.timeout_ms = s.number_or("timeout_ms", out.timeout_ms, {1, 10'000});
  out.start_s = s.number_or("start_s", out.start_s, config::kPositive);
  out.stiffness = s.number_or("stiffness", 0, config::kPositive);
  out.damping = s.number_or("damping", 0, config::kPositive);
  s.finish();
  YAML::Node node = YAML::Load(out.config);
  node.remove("check");
  YAML::Emitter emitter;
  emitter << node;
  out.config = emitter.c_str();
  return out;
}

std::vector<Result> run(const Options& options) {
  const Result loaded = in_child({"load", "", load}, options);
  if (loaded.outcome != Outcome::kPassed) throw std::runtime_error(loaded.reason);
  std::vector<Result> results;
  bool usable = true;
  for (const auto& group : {interface_checks(), reading_checks(), motion_checks(), port_checks()}) {
    for (const Check& check : group) {
      if (!options.only.empty() && options.only != check.name && !results.empty()) continue;
      if (usable) {
        results.push_back(in_child(check, options));
      } else {
        results.push_back({check.name, check.proves, Outcome::kSkipped, "no usable interface"});
      }
      // Without the right interface nothing can be called.
      if (results.size() == 1) usable = results[0].outcome == Outcome::kPassed;
    }
  }
  return results;
}

bool conforms(const std::vector<Result>& results) {
  for (const Result& r : results) {
    if (r.outcome == Outcome::kFailed) return false;
  }
  return true;
}

}  // namespace wb::check
