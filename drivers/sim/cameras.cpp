#include "drivers/sim/cameras.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace wb::sim {
namespace {

constexpr int kQuantileBits = 12;
constexpr int kDropoutBits = 20;

// The standard normal's quantiles at the middles of equal shares, scaled to unit variance: noise
// for one table look-up a pixel.
std::vector<float> normal_quantiles() {
  constexpr int kCount = 1 << kQuantileBits;
  std::vector<double> z(kCount);
  double square = 0;
  for (int i = 0; i < kCount; ++i) {
    const double share = (i + 0.5) / kCount;
    double low = -6, high = 6;
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (low + high);
      (0.5 * std::erfc(-middle * std::numbers::sqrt2 / 2) < share ? low : high) = middle;
    }
    z[i] = low;
    square += low * low / kCount;
  }
  std::vector<float> out;
  for (const double v : z) out.push_back(static_cast<float>(v / std::sqrt(square)));
  return out;
}

}  // namespace

Cameras::Camera::Camera(const CameraConfig& config, const Plant& plant, std::uint64_t seed,
                        std::uint64_t index, bool colour)
    : body(plant.body(config.name)),
      intrinsics(config.intrinsics),
      rate_hz(config.rate_hz),
      random(seed, kCameraStream + index) {
  const std::size_t pixels = static_cast<std::size_t>(intrinsics.width) * intrinsics.height;
  for (Slot& slot : slots) {
    slot.depth.resize(pixels);
    slot.colour.resize(colour ? 3 * pixels : 0);
  }
}

bool Cameras::Camera::due(TimeNs t_ns) const noexcept {
  return t_ns >= static_cast<TimeNs>(std::ceil(1e9 * static_cast<double>(next) / rate_hz));
}

Cameras::Cameras(const PluginConfig& config, const Plant& plant)
    : noise_(config.scene.noise),
      delay_ns_(from_seconds(config.scene.noise.camera_delay_s)),
      colour_(config.colour),
      normal_quantiles_(normal_quantiles()),
      painter_(plant.model(), config.scene.light),
      exposures_(config.render_thread ? kExposures : 1, Exposure{GeomPoses(plant.model()), {}, 0}) {
  int width = 1, height = 1;
  for (std::size_t i = 0; i < config.robot.cameras.size(); ++i) {
    cameras_.push_back(
        std::make_unique<Camera>(config.robot.cameras[i], plant, config.seed, i, colour_));
    width = std::max(width, cameras_.back()->intrinsics.width);
    height = std::max(height, cameras_.back()->intrinsics.height);
  }
  caster_ = std::make_unique<RayCaster>(plant.model(), width, height);
  if (config.render_thread) worker_ = std::thread([this] { work(); });
}

Cameras::~Cameras() {
  stopping_.store(true);
  work_.release();
  if (worker_.joinable()) worker_.join();
}

void Cameras::expose(const Plant& plant, TimeNs offset_ns) noexcept {
  const TimeNs t_ns = plant.time_ns();
  now_ns_.store(t_ns + offset_ns, std::memory_order_release);
  unsigned due = 0;
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    Camera& camera = *cameras_[i];
    if (!camera.due(t_ns)) continue;
    due |= 1u << i;
    while (camera.due(t_ns)) ++camera.next;  // a rate above the physics' skips
  }
  if (due == 0) return;
  if (handed_ - developed_.load(std::memory_order_acquire) == exposures_.size()) {
    dropped_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  Exposure& exposure = exposures_[handed_ % exposures_.size()];
  exposure.due = due;
  exposure.poses.take(plant.data(), t_ns + offset_ns);
  for (std::size_t i = 0; i < cameras_.size(); ++i) exposure.X_SC[i] = plant.X_S(cameras_[i]->body);
  if (worker_.joinable()) {
    ++handed_;
    work_.release();
  } else {
    develop(exposure);
  }
}

void Cameras::work() noexcept {
  for (;;) {
    work_.acquire();
    if (stopping_.load()) return;
    const std::uint64_t number = developed_.load(std::memory_order_relaxed);
    develop(exposures_[number % exposures_.size()]);
    developed_.store(number + 1, std::memory_order_release);
  }
}

void Cameras::develop(const Exposure& exposure) noexcept {
  for (std::size_t i = 0; i < cameras_.size(); ++i) {
    if (!(exposure.due & (1u << i))) continue;
    Camera& camera = *cameras_[i];
    Slot* slot = take_slot(camera);
    if (slot == nullptr) {
      dropped_.fetch_add(1, std::memory_order_relaxed);
      continue;
    }
    const CameraIntrinsics& k = camera.intrinsics;
    caster_->render(exposure.poses, exposure.X_SC[i], k);
    for (int v = 0; v < k.height; ++v)
      std::copy_n(caster_->depth_row(v), k.width, slot->depth.begin() + v * k.width);
    if (colour_) painter_.paint(*caster_, exposure.poses, exposure.X_SC[i], k, slot->colour.data());
    add_noise(camera, slot->depth);
    slot->t_ns.store(exposure.poses.t_ns, std::memory_order_relaxed);
    slot->state.store(kReady, std::memory_order_release);
  }
}

// A free slot, or else the oldest that nobody took yet.
Cameras::Slot* Cameras::take_slot(Camera& camera) noexcept {
  for (Slot& slot : camera.slots) {
    if (slot.state.load(std::memory_order_acquire) == kFree) {
      slot.state.store(kWriting, std::memory_order_relaxed);
      return &slot;
    }
  }
  Slot* oldest = nullptr;
  for (Slot& slot : camera.slots) {
    if (slot.state.load(std::memory_order_acquire) == kReady &&
        (!oldest || slot.t_ns < oldest->t_ns))
      oldest = &slot;
  }
  int expected = kReady;
  if (!oldest ||
      !oldest->state.compare_exchange_strong(expected, kWriting, std::memory_order_acq_rel))
    return nullptr;
  dropped_.fetch_add(1, std::memory_order_relaxed);
  return oldest;
}

void Cameras::add_noise(Camera& camera, std::vector<float>& depth) noexcept {
  constexpr std::uint32_t kQuantileMask = (1u << kQuantileBits) - 1;
  const auto dropout = static_cast<std::uint32_t>(noise_.depth_dropout * (1u << kDropoutBits));
  const auto sigma = static_cast<float>(noise_.depth_per_m);
  const auto low = static_cast<float>(camera.intrinsics.range_min_m),
             high = static_cast<float>(camera.intrinsics.range_max_m);
  constexpr float kNone = std::numeric_limits<float>::infinity();
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < depth.size(); ++i) {
    bits = i % 2 == 0 ? camera.random.bits() : bits >> 32;
    const auto word = static_cast<std::uint32_t>(bits);
    const float z = depth[i];
    const bool seen = z >= low && z <= high && (word >> kQuantileBits) >= dropout;
    depth[i] = seen ? z + sigma * z * z * normal_quantiles_[word & kQuantileMask] : kNone;
  }
}

wb_status Cameras::acquire(wb_frame& frame) noexcept {
  const TimeNs visible = now_ns_.load(std::memory_order_acquire) - delay_ns_;
  for (;;) {
    Slot* oldest = nullptr;
    std::size_t index = 0;
    for (std::size_t i = 0; i < cameras_.size(); ++i) {
      for (Slot& slot : cameras_[i]->slots) {
        if (slot.state.load(std::memory_order_acquire) != kReady || slot.t_ns > visible) continue;
        if (!oldest || slot.t_ns < oldest->t_ns) {
          oldest = &slot;
          index = i;
        }
      }
    }
    if (!oldest) return WB_NO_DATA;
    int expected = kReady;
    if (!oldest->state.compare_exchange_strong(expected, kTaken, std::memory_order_acq_rel))
      continue;
    if (oldest->t_ns > visible) {  // overwritten meanwhile by one that is still under way
      oldest->state.store(kReady, std::memory_order_release);
      continue;
    }
    frame.camera = static_cast<std::uint32_t>(index);
    frame.t_ns = oldest->t_ns;
    frame.depth = oldest->depth.data();
    frame.colour = colour_ ? oldest->colour.data() : nullptr;
    frame.token =
        index * kSlots + static_cast<std::uint64_t>(oldest - cameras_[index]->slots.data());
    return WB_OK;
  }
}

wb_status Cameras::release(std::uint64_t token) noexcept {
  if (token >= cameras_.size() * kSlots) return WB_ERROR;
  Slot& slot = cameras_[token / kSlots]->slots[token % kSlots];
  int expected = kTaken;
  return slot.state.compare_exchange_strong(expected, kFree, std::memory_order_acq_rel) ? WB_OK
                                                                                        : WB_ERROR;
}

}  // namespace wb::sim
