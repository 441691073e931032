// FNV-1a over the values of a step's outputs, field by field so that padding never counts.
// "state_hash" of DEFINITIONS.md.
#pragma once
#include <cstdint>
#include <cstring>

#include "core/types/command.hpp"
#include "core/types/robot_state.hpp"

namespace wb {

class StateHash {
 public:
  void add(const RobotState& s) noexcept {
    add(s.t_ns);
    add(static_cast<int>(s.mode));
    add(static_cast<int>(s.phase));
    add_all(s.base);
    add_all(s.base_velocity);
    add_all(s.q);
    add_all(s.dq);
    add_all(s.tau);
    add_all(s.q_command);
    add_all(s.wrench);
    add_all(s.gyro);
    add_all(s.acceleration);
    add(s.gripper_opening_m);
    add(s.gripper_force_n);
  }
  void add(const SafeCommand& safe) noexcept {
    const Command& c = safe.get();
    add(static_cast<int>(safe.reason()));
    for (int i = 0; i < c.joint_count; ++i) add(c.joints[i]);
    for (int i = 0; i < c.wheel_count; ++i) add(c.wheels[i]);
    add(c.gripper.opening_m);
    add(c.gripper.force_n);
  }
  std::uint64_t value() const { return hash_; }

 private:
  void add(const JointCommand& j) noexcept {
    add(static_cast<int>(j.kind));
    for (const double v : {j.position, j.velocity, j.torque, j.stiffness, j.damping}) add(v);
  }
  template <class Array>
  void add_all(const Array& values) noexcept {
    for (const double v : values) add(v);
  }
  template <class T>
  requires std::is_arithmetic_v<T>
  void add(T value) noexcept {
    unsigned char bytes[sizeof value];
    std::memcpy(bytes, &value, sizeof value);
    for (const unsigned char b : bytes) {
      hash_ ^= b;
      hash_ *= 1099511628211ull;
    }
  }
  std::uint64_t hash_ = 14695981039346656037ull;
};

}  // namespace wb
