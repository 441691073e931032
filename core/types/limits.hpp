// Compile-time upper bounds of run-time dimensions, so that buffered values need no heap.
#pragma once

namespace wb {

inline constexpr int kMaxJoints = 16;     // position-controlled joints (without wheels and fingers)
inline constexpr int kMaxWheels = 4;      // velocity-controlled wheels
inline constexpr int kMaxStates = 16;     // rows of the MPC state x
inline constexpr int kMaxInputs = 16;     // rows of the MPC input u
inline constexpr int kMaxNodes = 96;      // nodes of a Policy
inline constexpr int kMaxKeyframes = 64;  // end-effector or base keyframes in a Reference
inline constexpr int kMaxEndEffectors = 2;
inline constexpr int kMaxWeights = 96;     // weights of the MPC that may be tuned
inline constexpr int kMaxNameLength = 32;  // object and joint names, terminating zero included
inline constexpr int kMaxRequests = 8;     // requests handed to one step
inline constexpr int kMaxCameras = 8;

}  // namespace wb
