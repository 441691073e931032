// The recording file: what every step was handed. One writer job, any reader. Valid for one build
// on one kind of CPU: values are stored as they lie in memory, and the header names their sizes, so
// that another build's file is refused, not misread.
#pragma once
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "daemon/arrows.hpp"

namespace wb {

enum class RecordType : std::uint8_t {
  kControl = 1,
  kMpc = 2,
  kMapping = 3,
  kPlan = 4,
  kFrame = 5
};

struct RecordingHeader {
  std::string build;             // sizes of the record types
  std::string robot;             // folder
  std::uint64_t robot_hash = 0;  // over the folder's files
  std::vector<std::string> disabled_terms;
};

// FNV-1a over the names and contents of a robot folder's files.
std::uint64_t hash_folder(const std::filesystem::path& folder);

class RecordingWriter {
 public:
  // Throws std::runtime_error if the file cannot be written.
  RecordingWriter(const std::filesystem::path& file, const std::filesystem::path& robot_folder,
                  const std::vector<std::string>& disabled_terms);
  ~RecordingWriter();

  // Writes everything that waits in the record queues. Ordinary thread, often enough that none
  // overflows.
  void drain(Arrows& arrows);
  bool failed() const { return failed_; }  // the disk refused something

 private:
  void put(RecordType type, const void* data, std::size_t size);
  template <class T, std::size_t N>
  void drain(RecordType type, Queue<T, N>& queue);
  std::FILE* file_;
  bool failed_ = false;
};

class RecordingReader {
 public:
  // Throws std::runtime_error: cannot be opened, no recording, another build.
  explicit RecordingReader(const std::filesystem::path& file);

  RecordingHeader header;
  std::vector<ControlRecord> control;
  std::vector<MpcRecord> mpc;
  std::vector<MappingRecord> mapping;
  std::vector<ObjectPlan> plans;
  bool truncated = false;  // the last record is cut off: the daemon died while writing

  // Loads the frame with this sequence number into `frame`; false if it is not in the file.
  bool frame(std::uint64_t seq, DepthFrame& frame) const;

 private:
  struct Close {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  std::unique_ptr<std::FILE, Close> file_;
  struct FrameIndex {
    std::uint64_t seq;
    long offset;
  };
  std::vector<FrameIndex> frames_;
};

}  // namespace wb
