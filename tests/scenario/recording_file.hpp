// A recording on disk as a test handles it: a temporary file whose bytes may be changed. Layout:
// daemon/recording.cpp.
#pragma once
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

#include "daemon/recording.hpp"

namespace wb::test {

class RecordingFile {
 public:
  RecordingFile() = default;
  ~RecordingFile() { std::filesystem::remove(path_); }
  RecordingFile(const RecordingFile&) = delete;
  RecordingFile& operator=(const RecordingFile&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::string bytes() const {
    std::ifstream in(path_, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  }
  void write(const std::string& bytes) const {
    std::ofstream(path_, std::ios::binary | std::ios::trunc) << bytes;
  }

 private:
  std::filesystem::path path_ =
      std::filesystem::temp_directory_path() / ("wb_recording_" + std::to_string(getpid()));
};

// Where the header's line `line` (0: magic, 1: build, 2: robot, 3: hash of its files, 4: terms)
// begins; 5: the first record.
inline std::size_t line_start(const std::string& bytes, int line) {
  std::size_t at = 0;
  for (int i = 0; i < line; ++i) at = bytes.find('\n', at) + 1;
  return at;
}

// Where the data of the index-th record of a type begin. Throws std::runtime_error if there are
// fewer.
inline std::size_t record_start(const std::string& bytes, RecordType type, std::size_t index) {
  std::size_t at = line_start(bytes, 5);
  while (at + 5 <= bytes.size()) {
    std::uint32_t size;
    std::memcpy(&size, bytes.data() + at + 1, sizeof size);
    const bool wanted = static_cast<RecordType>(bytes[at]) == type;
    at += 5;
    if (wanted && index-- == 0) return at;
    at += size;
  }
  throw std::runtime_error("the recording has no such record");
}

}  // namespace wb::test
