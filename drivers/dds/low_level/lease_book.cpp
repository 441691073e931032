#include "drivers/dds/low_level/lease_book.hpp"

#include <algorithm>

namespace wb::dds {

LeaseBook::Answer LeaseBook::ask(std::uint64_t claim, const std::string& holder, TimeNs now) {
  if (claim == 0) return {0, false, "claim 0"};
  if (lease_ != 0 && claim == claim_) {
    heard_ns_ = now;
    return {lease_, false, ""};
  }
  if (std::find(ended_.begin(), ended_.end(), claim) != ended_.end())
    return {0, false, "this claim has ended"};
  if (lease_ != 0) return {0, false, "held by " + holder_};
  claim_ = claim;
  holder_ = holder;
  heard_ns_ = now;
  do {
    lease_ = (std::uint64_t{random_()} << 32) | random_();
  } while (lease_ == 0);
  return {lease_, true, ""};
}

bool LeaseBook::release(std::uint64_t claim) {
  if (lease_ == 0 || claim != claim_) return false;
  end();
  return true;
}

bool LeaseBook::expire(TimeNs now) {
  if (lease_ == 0 || now - heard_ns_ <= silence_ns_) return false;
  end();
  return true;
}

void LeaseBook::end() {
  ended_.push_back(claim_);
  if (ended_.size() > kRemembered) ended_.pop_front();
  lease_ = claim_ = 0;
  holder_.clear();
}

}  // namespace wb::dds
