#include "daemon/recording.hpp"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace wb {
namespace {

static_assert(std::is_trivially_copyable_v<ControlRecord> &&
              std::is_trivially_copyable_v<MpcRecord> &&
              std::is_trivially_copyable_v<MappingRecord> &&
              std::is_trivially_copyable_v<ObjectPlan>);

constexpr char kMagic[] = "WBREC1\n";

// A frame without its pixels, which follow it in the file.
struct FrameHead {
  std::uint64_t seq;
  TimeNs t_ns;
  int camera;
  CameraIntrinsics intrinsics;
};

std::string build_id() {
  std::ostringstream out;
  out << "control " << sizeof(ControlRecord) << ", mpc " << sizeof(MpcRecord) << ", mapping "
      << sizeof(MappingRecord) << ", plan " << sizeof(ObjectPlan) << ", frame " << sizeof(FrameHead)
      << ", compiler " << __VERSION__;
  return out.str();
}

void fnv(std::uint64_t& hash, const std::string& bytes) {
  for (const unsigned char b : bytes) {
    hash ^= b;
    hash *= 1099511628211ull;
  }
}

std::string read_line(std::FILE* f) {
  std::string line;
  for (int c; (c = std::fgetc(f)) != EOF && c != '\n';) line.push_back(static_cast<char>(c));
  return line;
}

}  // namespace

std::uint64_t hash_folder(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::uint64_t hash = 14695981039346656037ull;
  for (const auto& file : files) {
    std::ifstream in(file, std::ios::binary);
    fnv(hash, file.filename().string());
    fnv(hash, std::string(std::istreambuf_iterator<char>(in), {}));
  }
  return hash;
}

RecordingWriter::RecordingWriter(const std::filesystem::path& file,
                                 const std::filesystem::path& robot_folder,
                                 const std::vector<std::string>& disabled_terms)
    : file_(std::fopen(file.c_str(), "wb")) {
  if (!file_)
    throw std::runtime_error("recording " + file.string() +
                             " cannot be written: " + std::strerror(errno));
  std::string terms;
  for (const std::string& t : disabled_terms) terms += t + " ";
  const std::string head = kMagic + build_id() + "\n" +
                           std::filesystem::absolute(robot_folder).string() + "\n" +
                           std::to_string(hash_folder(robot_folder)) + "\n" + terms + "\n";
  failed_ = std::fwrite(head.data(), 1, head.size(), file_) != head.size();
}

RecordingWriter::~RecordingWriter() { std::fclose(file_); }

void RecordingWriter::put(RecordType type, const void* data, std::size_t size) {
  const auto bytes = static_cast<std::uint32_t>(size);
  failed_ = std::fwrite(&type, sizeof type, 1, file_) != 1 ||
            std::fwrite(&bytes, sizeof bytes, 1, file_) != 1 ||
            std::fwrite(data, 1, size, file_) != size || failed_;
}

template <class T, std::size_t N>
void RecordingWriter::drain(RecordType type, Queue<T, N>& queue) {
  while (const T* record = queue.peek()) {
    put(type, record, sizeof(T));
    queue.pop();
  }
}

void RecordingWriter::drain(Arrows& arrows) {
  while (const DepthFrame* f = arrows.frame_records.peek()) {
    const FrameHead head{f->seq, f->t_ns, f->camera, f->intrinsics};
    const std::size_t pixels = f->depth.size() * sizeof(float);
    const auto type = RecordType::kFrame;
    const auto bytes = static_cast<std::uint32_t>(sizeof head + pixels);
    failed_ = std::fwrite(&type, sizeof type, 1, file_) != 1 ||
              std::fwrite(&bytes, sizeof bytes, 1, file_) != 1 ||
              std::fwrite(&head, sizeof head, 1, file_) != 1 ||
              std::fwrite(f->depth.data(), 1, pixels, file_) != pixels || failed_;
    arrows.frame_records.pop();
  }
  drain(RecordType::kPlan, arrows.plan_records);
  drain(RecordType::kMapping, arrows.mapping_records);
  drain(RecordType::kMpc, arrows.mpc_records);
  drain(RecordType::kControl, arrows.control_records);
}

RecordingReader::RecordingReader(const std::filesystem::path& file)
    : file_(std::fopen(file.c_str(), "rb")) {
  const std::string name = "recording " + file.string();
  if (!file_) throw std::runtime_error(name + " cannot be opened: " + std::strerror(errno));
  std::FILE* f = file_.get();
  if (read_line(f) + "\n" != kMagic) throw std::runtime_error(name + " is not a recording");
  header.build = read_line(f);
  if (header.build != build_id())
    throw std::runtime_error(name + " was made by another build (" + header.build +
                             "; this one: " + build_id() + ")");
  header.robot = read_line(f);
  const std::string hash = read_line(f);
  const auto [end, error] =
      std::from_chars(hash.data(), hash.data() + hash.size(), header.robot_hash);
  if (error != std::errc() || end != hash.data() + hash.size())
    throw std::runtime_error(name + " is damaged: its header is cut off");
  std::istringstream terms(read_line(f));
  for (std::string t; terms >> t;) header.disabled_terms.push_back(t);

  const auto size = static_cast<long>(
      std::filesystem::file_size(file));  // a seek goes beyond it without complaint
  const auto take = [&](auto& list, std::uint32_t bytes) {
    using T = typename std::remove_reference_t<decltype(list)>::value_type;
    if (bytes != sizeof(T))
      throw std::runtime_error(name + " is damaged: a record has the wrong size");
    T value;
    if (std::fread(&value, sizeof value, 1, f) != 1) return false;
    list.push_back(value);
    return true;
  };
  for (;;) {
    std::uint8_t type;
    std::uint32_t bytes;
    if (std::fread(&type, sizeof type, 1, f) != 1) break;  // the end
    bool whole = std::fread(&bytes, sizeof bytes, 1, f) == 1;
    if (whole) {
      switch (static_cast<RecordType>(type)) {
        case RecordType::kControl:
          whole = take(control, bytes);
          break;
        case RecordType::kMpc:
          whole = take(mpc, bytes);
          break;
        case RecordType::kMapping:
          whole = take(mapping, bytes);
          break;
        case RecordType::kPlan:
          whole = take(plans, bytes);
          break;
        case RecordType::kFrame: {
          FrameHead head;
          const long offset = std::ftell(f);
          whole = bytes >= sizeof head && std::fread(&head, sizeof head, 1, f) == 1 &&
                  std::fseek(f, static_cast<long>(bytes - sizeof head), SEEK_CUR) == 0 &&
                  std::ftell(f) <= size;
          if (whole) frames_.push_back({head.seq, offset});
          break;
        }
        default:
          throw std::runtime_error(name + " is damaged: record of unknown type " +
                                   std::to_string(type));
      }
    }
    if (!whole) {
      truncated = true;
      break;
    }
  }
}

bool RecordingReader::frame(std::uint64_t seq, DepthFrame& frame) const {
  const auto it = std::lower_bound(frames_.begin(), frames_.end(), seq,
                                   [](const FrameIndex& f, std::uint64_t s) { return f.seq < s; });
  if (it == frames_.end() || it->seq != seq) return false;
  FrameHead head;
  if (std::fseek(file_.get(), it->offset, SEEK_SET) != 0 ||
      std::fread(&head, sizeof head, 1, file_.get()) != 1)
    return false;
  frame.seq = head.seq;
  frame.t_ns = head.t_ns;
  frame.camera = head.camera;
  frame.intrinsics = head.intrinsics;
  frame.depth.resize(static_cast<std::size_t>(head.intrinsics.width) * head.intrinsics.height);
  return std::fread(frame.depth.data(), sizeof(float), frame.depth.size(), file_.get()) ==
         frame.depth.size();
}

}  // namespace wb
