// The depth cameras: exposures on the plant's time, noise, delay, and the ring of frames that the
// plugin owns. Exposure k of a camera is taken at the first physics step at or after ceil(k /
// rate), stamped with that step's time, and can be acquired once the delay has passed. expose()
// runs in the port that advances the plant and renders there (about 0.1 ms a frame), or hands the
// geoms' poses to a worker thread. acquire() and release(): one other thread.
#pragma once
#include <array>
#include <atomic>
#include <memory>
#include <semaphore>
#include <thread>

#include "core/types/limits.hpp"
#include "drivers/sim/painter.hpp"
#include "drivers/sim/plant.hpp"
#include "drivers/sim/ray_caster.hpp"

namespace wb::sim {

class Cameras {
 public:
  Cameras(const PluginConfig& config, const Plant& plant);
  ~Cameras();

  // Takes the exposures that are due. The frames' stamps are the plant's time plus offset_ns, the
  // host's clock.
  void expose(const Plant& plant, TimeNs offset_ns) noexcept;
  wb_status acquire(wb_frame& frame) noexcept;
  wb_status release(std::uint64_t token) noexcept;
  // Exposures that found no free slot, and frames overwritten before they were taken.
  std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  static constexpr int kSlots = 6;      // of each camera
  static constexpr int kExposures = 4;  // that may wait for the worker

  enum SlotState : int { kFree, kWriting, kReady, kTaken };
  struct Slot {
    std::atomic<int> state{kFree};
    std::atomic<TimeNs> t_ns{0};
    std::vector<float> depth;
    std::vector<std::uint8_t> colour;
  };
  struct Camera {
    int body = 0;
    CameraIntrinsics intrinsics;
    double rate_hz = 0;
    std::int64_t next = 0;  // number of the next exposure
    Random random;
    std::array<Slot, kSlots> slots;

    Camera(const CameraConfig& config, const Plant& plant, std::uint64_t seed, std::uint64_t index,
           bool colour);
    bool due(TimeNs t_ns) const noexcept;
  };
  struct Exposure {
    GeomPoses poses;
    std::array<Eigen::Isometry3d, kMaxCameras> X_SC;
    unsigned due = 0;  // bit mask of cameras
  };

  void develop(const Exposure& exposure) noexcept;
  Slot* take_slot(Camera& camera) noexcept;
  void add_noise(Camera& camera, std::vector<float>& depth) noexcept;
  void work() noexcept;

  NoiseConfig noise_;
  TimeNs delay_ns_ = 0;
  bool colour_ = false;
  std::vector<std::unique_ptr<Camera>> cameras_;
  std::vector<float> normal_quantiles_;
  std::unique_ptr<RayCaster> caster_;
  Painter painter_;
  std::vector<Exposure> exposures_;  // a ring for the worker; without one, only the first is used
  std::atomic<TimeNs> now_ns_{0};    // on the host's clock
  std::atomic<std::uint64_t> dropped_{0};

  std::uint64_t handed_ = 0;
  std::atomic<std::uint64_t> developed_{0};
  std::counting_semaphore<> work_{0};
  std::atomic<bool> stopping_{false};
  std::thread worker_;
};

}  // namespace wb::sim
