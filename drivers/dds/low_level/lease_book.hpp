// Who may command: one holder at a time, who loses the lease by release or by silence. A claim that
// has ended is never granted again, so that a commander that was cut off must activate anew. Pure;
// times: any steady clock.
#pragma once
#include <cstdint>
#include <deque>
#include <random>
#include <string>

#include "core/types/time.hpp"

namespace wb::dds {

class LeaseBook {
 public:
  explicit LeaseBook(TimeNs silence_ns) : silence_ns_(silence_ns) {}

  struct Answer {
    std::uint64_t lease = 0;  // 0: refused
    bool is_new = false;
    std::string reason;
  };
  Answer ask(std::uint64_t claim, const std::string& holder, TimeNs now);
  bool release(std::uint64_t claim);              // true: the lease has ended by this
  bool expire(TimeNs now);                        // likewise
  void heard(TimeNs now) { heard_ns_ = now; }     // a sign of life of the holder
  std::uint64_t lease() const { return lease_; }  // 0: nobody's
  const std::string& holder() const { return holder_; }
  TimeNs silence_ns() const { return silence_ns_; }

 private:
  static constexpr std::size_t kRemembered = 64;
  void end();

  TimeNs silence_ns_, heard_ns_ = 0;
  std::uint64_t lease_ = 0, claim_ = 0;
  std::string holder_;
  std::deque<std::uint64_t> ended_;
  std::random_device random_;
};

}  // namespace wb::dds
