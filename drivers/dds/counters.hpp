// What was refused, counted by kind: samples (joints, IMU, wrench, truth) and camera frames.
// Written by the DDS thread (and the one that advances), read by any.
#pragma once
#include <array>
#include <atomic>
#include <cstdint>
#include <string>

namespace wb::dds {

// Why a sample is not used.
enum class Fault {
  kNone,
  kMalformed,  // contradicts itself, or a field out of its range
  kNonFinite,
  kWrongSize,    // other joints, pixels or bytes than agreed
  kWrongSource,  // another low-level computer, session or frame
  kDuplicate,    // a sequence number or stamp again
  kOutOfOrder,
  kFrozen,  // a newer number with an old stamp
  kStale,
  kFuture,
  kEncoding,      // of pixels or points that this plugin does not read
  kUncalibrated,  // without CameraInfo, or with another than at the start
  kCount
};

enum class Stream { kSamples, kFrames, kCount };

class Counters {
 public:
  Counters();
  Fault count(Stream stream, Fault fault) noexcept {
    if (fault != Fault::kNone) add(index(stream, fault));
    return fault;
  }
  void frame_lost() noexcept { add(kFrameLost); }
  void lease_lost() noexcept { add(kLeaseLost); }
  void command_unsent() noexcept { add(kCommandUnsent); }
  void tick_unanswered() noexcept { add(kTickUnanswered); }

  static constexpr std::size_t size() { return kSize; }
  const char* const* names() const { return name_pointers_.data(); }  // as long as this lives
  std::uint64_t value(std::size_t i) const noexcept {
    return counts_[i].load(std::memory_order_relaxed);
  }

 private:
  static constexpr std::size_t kFaults = static_cast<std::size_t>(Fault::kCount) - 1;
  static constexpr std::size_t kFrameLost = static_cast<std::size_t>(Stream::kCount) * kFaults;
  static constexpr std::size_t kLeaseLost = kFrameLost + 1;
  static constexpr std::size_t kCommandUnsent = kFrameLost + 2;
  static constexpr std::size_t kTickUnanswered = kFrameLost + 3;
  static constexpr std::size_t kSize = kFrameLost + 4;
  static constexpr std::size_t index(Stream stream, Fault fault) {
    return static_cast<std::size_t>(stream) * kFaults + static_cast<std::size_t>(fault) - 1;
  }
  void add(std::size_t i) noexcept { counts_[i].fetch_add(1, std::memory_order_relaxed); }

  std::array<std::atomic<std::uint64_t>, kSize> counts_{};
  std::array<std::string, kSize> names_;
  std::array<const char*, kSize> name_pointers_;
};

}  // namespace wb::dds
