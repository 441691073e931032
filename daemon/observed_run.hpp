// `wholebodyd --observe`: watches the requests for one object with the simulator's truth and says
// how each ended: a line on stdout; run.csv, summary.json and pictures (PPM) in a folder, where the
// newest run replaces the one before. Lockstep only: everything is called by the thread that
// advances the plant.
#pragma once
#include <filesystem>
#include <optional>
#include <string>

#include "daemon/run_observer.hpp"

namespace wb {

class ObservedRun {
 public:
  // Makes the folder. Throws std::runtime_error if that fails or the scene has no such object.
  ObservedRun(System& system, const std::string& object, const std::filesystem::path& folder);

  void after_instant(TimeNs t);

 private:
  void end(TimeNs t, const RequestStatus& status);

  System& system_;
  const std::string object_;
  const std::filesystem::path folder_;
  std::optional<RunObserver> observer_;  // while a request for the object runs
  TimeNs start_ = 0;
  std::uint64_t seen_ = 0;  // request that was watched last
};

}  // namespace wb
