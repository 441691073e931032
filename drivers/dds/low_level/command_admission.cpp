#include "drivers/dds/low_level/command_admission.hpp"

#include <algorithm>

namespace wb::dds {

void CommandAdmission::begin_lease() noexcept {
  commanded_ = stopped_ = false;
  sequence_ = heard_sequence_ = 0;
  refusal_ = "";
}

bool CommandAdmission::end_lease() noexcept {
  const bool must_stop = moving();
  commanded_ = stopped_ = false;
  sequence_ = 0;
  return must_stop;
}

const char* CommandAdmission::reason(const msg::JointCommands& c, const Moment& m) const noexcept {
  if (c.lease_ == 0 || c.lease_ != m.lease) return "not the holder's lease";
  if (c.sequence_ <= heard_sequence_) return "duplicate or out of order";
  if (c.stop_) return nullptr;  // in time or not
  if (stopped_) return "stopped until a new lease";
  if (m.emergency_stop) return "emergency stop";
  return refuse(c, robot_, m.stamp_ns, m.memory_ns);
}

CommandAdmission::Verdict CommandAdmission::take(const msg::JointCommands& c, const Moment& m,
                                                 wb_commands& out) noexcept {
  const char* why = reason(c, m);
  if (c.lease_ != 0 && c.lease_ == m.lease)
    heard_sequence_ = std::max(heard_sequence_, c.sequence_);
  if (why != nullptr) {
    refusal_ = why;
    return Verdict::kRefused;
  }
  sequence_ = c.sequence_;
  if (c.stop_) {
    const bool again = stopped_;
    stopped_ = true;
    return again ? Verdict::kStopped : Verdict::kStop;
  }
  refusal_ = "";
  command_ns_ = m.now_ns;
  valid_for_ns_ = c.valid_for_ns_;
  commanded_ = true;
  clip(c, robot_, out);
  return Verdict::kApply;
}

}  // namespace wb::dds
