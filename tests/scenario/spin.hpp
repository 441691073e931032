// Makes one thread of a child process spin for ever, as a step with an endless loop would: stops it
// by ptrace and sends it to a `jmp .` (the bytes EB FE, which stand somewhere in the process's
// code). x86-64.
#pragma once
#include <sys/ptrace.h>
#include <sys/user.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace wb::test {

inline pid_t find_thread(pid_t process, const std::string& name) {
  for (const auto& task :
       std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    std::string comm;
    std::getline(std::ifstream(task.path() / "comm"), comm);
    if (comm == name) return std::stoi(task.path().filename());
  }
  return 0;
}

// Address of a `jmp .` in executable memory, 0: none.
inline std::uint64_t find_endless_loop(pid_t process) {
  const std::string proc = "/proc/" + std::to_string(process);
  std::ifstream maps(proc + "/maps"), memory(proc + "/mem", std::ios::binary);
  std::string line;
  while (std::getline(maps, line)) {
    std::uint64_t begin = 0, end = 0;
    std::array<char, 5> rights{};
    if (std::sscanf(line.c_str(), "%lx-%lx %4s", &begin, &end, rights.data()) != 3) continue;
    if (rights[2] != 'x') continue;
    std::string code(end - begin, '\0');
    memory.clear();
    memory.seekg(static_cast<std::streamoff>(begin));
    memory.read(code.data(), static_cast<std::streamsize>(code.size()));
    const std::size_t at = code.find("\xEB\xFE");
    if (at != std::string::npos) return begin + at;
  }
  return 0;
}

[[nodiscard]] inline bool make_spin(pid_t thread, std::uint64_t loop) {
  if (thread == 0 || loop == 0 || ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) != 0) return false;
  int status = 0;
  user_regs_struct registers{};
  const bool done = ptrace(PTRACE_INTERRUPT, thread, nullptr, nullptr) == 0 &&
                    waitpid(thread, &status, __WALL) == thread &&
                    ptrace(PTRACE_GETREGS, thread, nullptr, &registers) == 0;
  if (done) {
    registers.rip = loop;
    registers.orig_rax =
        static_cast<unsigned long long>(-1);  // no system call to be taken up again
    ptrace(PTRACE_SETREGS, thread, nullptr, &registers);
  }
  return ptrace(PTRACE_DETACH, thread, nullptr, nullptr) == 0 && done;
}

}  // namespace wb::test
