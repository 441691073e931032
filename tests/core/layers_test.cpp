// One star: every folder includes only core/ and itself; planning/ also mpc/; drivers/dds also the
// messages; daemon/, tests/ and bench/ see everyone.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>

namespace {

namespace fs = std::filesystem;

TEST(Layers, EveryFolderIncludesOnlyWhatTheStarAllows) {
  const std::map<std::string, std::set<std::string>> allowed = {
      {"core", {"core"}},
      {"control", {"core", "control"}},
      {"mpc", {"core", "mpc"}},
      {"mapping", {"core", "mapping"}},
      {"perception", {"core", "perception"}},
      {"planning", {"core", "mpc", "planning"}},
      {"drivers", {"core", "drivers"}},
  };
  const std::regex include(R"re(^\s*#include\s+"([a-z_]+)/)re");
  int files = 0;
  for (const auto& [folder, may] : allowed) {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(WB_SOURCE_DIR) / folder)) {
      const std::string extension = entry.path().extension();
      if (extension != ".hpp" && extension != ".cpp" && extension != ".h") continue;
      ++files;
      std::ifstream in(entry.path());
      std::string line;
      for (int number = 1; std::getline(in, line); ++number) {
        std::smatch match;
        if (std::regex_search(line, match, include)) {
          const bool message = entry.path().string().find("/drivers/dds/") != std::string::npos &&
                               fs::exists(fs::path(WB_SOURCE_DIR) / "idl" / match[1].str());
          const bool helper = entry.path().filename() == "messages.hpp" && match[1] == "idl";
          EXPECT_TRUE(may.contains(match[1]) || message || helper)
              << entry.path() << ":" << number << ": " << line;
        }
      }
    }
  }
  EXPECT_GT(files, 20);
}

TEST(Layers, OnlyTheSimulatorLinksThePhysics) {
  for (const char* folder :
       {"core", "control", "mpc", "mapping", "perception", "planning", "daemon", "bench"}) {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(WB_SOURCE_DIR) / folder)) {
      if (!entry.is_regular_file()) continue;
      std::ifstream in(entry.path());
      const std::string text{std::istreambuf_iterator<char>(in), {}};
      EXPECT_EQ(text.find("#include <mujoco"), std::string::npos) << entry.path();
    }
  }
}

}  // namespace
