// `wbctl robot import` and `wbctl robot check`: arguments to text or JSON on stdout. Setup world;
// no daemon is asked. Return the exit code: 0 done, 1 a check failed, 2 refused (reason on stderr).
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace wb {

struct RobotImportArguments {
  std::filesystem::path file;
  std::string name;
  std::filesystem::path into = "config/robots";
  std::string base, end_effector;  // empty: guessed
  std::vector<std::filesystem::path> packages;
  int samples = 20000, seed = 1;
  bool force = false, json = false;
};
int robot_import_main(const RobotImportArguments& arguments);

struct RobotCheckArguments {
  std::string name;  // in `into`, or a folder
  std::filesystem::path into = "config/robots";
  int samples = 40, seed = 1;
  bool json = false;
};
int robot_check_main(const RobotCheckArguments& arguments);

}  // namespace wb
