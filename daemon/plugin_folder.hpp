// Where an executable finds the driver plugins unless told otherwise. Setup world.
#pragma once
#include <filesystem>

namespace wb {

// Plugins of an installed program lie beside it, in ../lib/wholebody; those of one in a build tree
// there.
inline std::filesystem::path default_plugin_folder() {
  std::error_code none;
  const auto installed =
      std::filesystem::read_symlink("/proc/self/exe", none).parent_path().parent_path() /
      "lib/wholebody";
  return std::filesystem::is_directory(installed, none) ? installed
                                                        : std::filesystem::path(WB_PLUGIN_DIR);
}

}  // namespace wb
