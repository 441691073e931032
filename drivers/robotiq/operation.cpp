#include "drivers/robotiq/operation.hpp"

namespace wb::robotiq {

void Operation::begin(const Status& status) noexcept {
  if (status.needs_reset()) {
    stage_ = Stage::kResetting;
  } else if (status.active && status.activation == Activation::kDone) {
    stage_ = Stage::kMoving;
  } else {
    stage_ = status.active ? Stage::kResetting : Stage::kActivating;
  }
}

bool Operation::next(const Request& request, bool hold, const Status& status,
                     Order& order) noexcept {
  if (request.written && !hold && request.activation != activation_) {
    activation_ = request.activation;
    begin(status);
  }
  // An activation that is broken off leaves the gripper reset, where it stands still.
  if (hold && (stage_ == Stage::kResetting || stage_ == Stage::kActivating)) stage_ = Stage::kLost;
  if (stage_ == Stage::kResetting && !status.active && status.activation == Activation::kReset)
    stage_ = Stage::kActivating;
  if (stage_ == Stage::kActivating && status.active && status.activation == Activation::kDone)
    stage_ = Stage::kMoving;
  else if (stage_ == Stage::kMoving && (!status.active || status.needs_reset()))
    stage_ = Stage::kLost;

  switch (stage_) {
    case Stage::kReading:
      return false;
    case Stage::kLost:
      if (!status.active || status.activation != Activation::kRunning) return false;
      order = {};
      return true;
    case Stage::kResetting:
      order = {};
      return true;
    case Stage::kActivating:
      order = sent_ = {.activate = true};
      return true;
    case Stage::kMoving:
      break;
  }
  // Not yet written to since the activation: goes on holding.
  if (hold || !request.written) {
    const bool moving = status.motion == Motion::kMoving || status.position_echo != sent_.position;
    if (!holding_ && moving)
      sent_.go = false;  // stops where it is; what it touches it goes on pressing
    holding_ = true;
    sent_.activate = true;
  } else {
    holding_ = false;
    sent_ = {true, true, request.position, speed_, request.force};
  }
  order = sent_;
  return true;
}

}  // namespace wb::robotiq
