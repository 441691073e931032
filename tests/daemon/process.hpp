// A program of the project as a child process of a test.
#pragma once
#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

namespace wb::test {

namespace fs = std::filesystem;

inline std::string contents(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

// A child process whose output goes to two files; killed if it outlives the test.
class Process {
 public:
  // Bound on the end of a process that was told to end; reached only when a test fails.
  static constexpr double kEndS = 30;

  // fifo_priority: of all its threads, where that is allowed; 0: ordinary.
  Process(std::vector<std::string> command, const fs::path& output, int fifo_priority = 0)
      : output_(output) {
    std::vector<char*> argv;
    for (auto& a : command) argv.push_back(a.data());
    argv.push_back(nullptr);
    child_ = fork();
    if (child_ != 0) return;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (fifo_priority > 0) {
      sched_param param{};
      param.sched_priority = fifo_priority;
      (void)sched_setscheduler(0, SCHED_FIFO, &param);
    }
    dup2(::open(out().c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDOUT_FILENO);
    dup2(::open(err().c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDERR_FILENO);
    execv(argv[0], argv.data());
    _exit(127);
  }
  ~Process() {
    if (child_ > 0) kill(child_, SIGKILL), waitpid(child_, nullptr, 0);
  }
  bool ended() {
    if (child_ > 0 && waitpid(child_, &status_, WNOHANG) == child_) child_ = 0;
    return child_ == 0;
  }
  // -1 if it did not end in time.
  int exit_code(double timeout_s = kEndS) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(timeout_s);
    while (!ended()) {
      if (std::chrono::steady_clock::now() > end) return -1;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return WIFEXITED(status_) ? WEXITSTATUS(status_) : -1;
  }
  int terminate() {
    send(SIGTERM);
    return exit_code();
  }
  void send(int signal) {
    if (child_ > 0) kill(child_, signal);
  }
  pid_t id() const { return child_; }
  fs::path out() const { return output_.string() + ".out"; }
  fs::path err() const { return output_.string() + ".err"; }

 private:
  fs::path output_;
  pid_t child_ = 0;
  int status_ = 0;
};

}  // namespace wb::test
