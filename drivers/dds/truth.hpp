// The simulated world's truth as it came over DDS, behind the table of drivers/sim/truth.h.
// store(): DDS thread. Everything else: the thread that calls advance().
#pragma once
#include <array>
#include <set>
#include <string>

#include "core/rt/latest.hpp"
#include "drivers/dds/samples.hpp"
#include "drivers/sim/truth.h"

namespace wb::dds {

struct TruthSample {
  static constexpr std::size_t kObjects = 32, kContacts = 64, kLinks = 64;
  struct Object {
    wb_sim_object object{};
    wb_sim_pose X_GE{};
    double clearance = 0;
  };
  struct Link {
    char name[32] = {};
    wb_sim_pose X_SL{};
  };
  std::uint64_t seq = 0;
  TimeNs stamp_ns = 0;
  wb_sim_pose base_pose{}, spawn_pose{};
  std::uint32_t object_count = 0, contact_count = 0, link_count = 0;
  std::array<Object, kObjects> objects{};
  std::array<wb_sim_contact, kContacts> contacts{};
  std::array<Link, kLinks> links{};
  double clearance = 0;
  std::uint64_t frames_dropped = 0;
};

class TruthStore {
 public:
  Fault store(const msg::Truth& in);
  std::uint64_t sequence() const { return sequence_; }  // newest that came; DDS thread
  // Another low-level computer starts to number anew.
  void expect(std::uint64_t boot) {
    boot_ = boot;
    sequence_ = 0;
  }
  const TruthSample& newest();  // empty before the first

 private:
  std::uint64_t boot_ = 0, sequence_ = 0;
  std::set<std::string> names_;  // contacts' names live as long as the driver
  Latest<TruthSample> samples_;
  const TruthSample none_{};
};

// The table for get_extension(); wb_driver's part of it is in plugin.cpp.
const wb_sim_truth* truth_table();

}  // namespace wb::dds
