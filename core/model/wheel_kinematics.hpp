// Body twist of a wheeled base to wheel speeds and back. Step world, any thread: noexcept, no
// allocation. The twist is (vx [m/s], vy [m/s], w [rad/s]) in B; wheel speeds [rad/s] stand in the
// order of BaseConfig::wheels. A differential drive has no vy. Four mecanum wheels, rollers at 45
// degrees (an X seen from above): the twist is the least-squares solution. Source: Siegwart et al.
// 2011, Sec. 3.2; Muir and Neuman 1987 (mecanum).
#pragma once
#include <array>

#include "core/model/robot_config.hpp"
#include "core/types/limits.hpp"

namespace wb {

class WheelKinematics {
 public:
  using Twist = std::array<double, 3>;
  using Wheels = std::array<double, kMaxWheels>;

  explicit WheelKinematics(const BaseConfig& base) noexcept
      : kind_(base.kind),
        radius_(base.wheel_radius_m),
        track_(base.track_m),
        lever_(0.5 * (base.track_m + base.wheelbase_m)),
        count_(static_cast<int>(base.wheels.size())) {}

  int wheels() const noexcept { return count_; }

  Wheels wheel_speeds(const Twist& v) const noexcept {
    Wheels out{};
    if (kind_ == BaseKind::kDifferentialDrive) {
      for (int i = 0; i < 2; ++i) out[i] = (v[0] + (i - 0.5) * track_ * v[2]) / radius_;
    } else if (kind_ == BaseKind::kOmnidirectional) {
      for (int i = 0; i < 4; ++i)
        out[i] = (v[0] + kSideways[i] * v[1] + kTurning[i] * lever_ * v[2]) / radius_;
    }
    return out;
  }

  // Also turns angles of the wheels into displacements in B.
  Twist twist(const Wheels& speeds) const noexcept {
    if (kind_ == BaseKind::kDifferentialDrive) {
      return {0.5 * radius_ * (speeds[0] + speeds[1]), 0.0,
              radius_ * (speeds[1] - speeds[0]) / track_};
    }
    Twist out{};
    if (kind_ == BaseKind::kOmnidirectional) {
      for (int i = 0; i < 4; ++i) {
        out[0] += 0.25 * radius_ * speeds[i];
        out[1] += 0.25 * radius_ * kSideways[i] * speeds[i];
        out[2] += 0.25 * radius_ * kTurning[i] * speeds[i] / lever_;
      }
    }
    return out;
  }

 private:
  // Front left, front right, rear left, rear right.
  static constexpr std::array<double, 4> kSideways = {-1, 1, 1, -1};
  static constexpr std::array<double, 4> kTurning = {-1, 1, -1, 1};

  BaseKind kind_;
  double radius_, track_, lever_;
  int count_;
};

}  // namespace wb
