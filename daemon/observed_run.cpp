#include "daemon/observed_run.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>

#include "daemon/json.hpp"

namespace wb {

ObservedRun::ObservedRun(System& system, const std::string& object,
                         const std::filesystem::path& folder)
    : system_(system), object_(object), folder_(folder) {
  (void)RunObserver(system, object, 1.0);  // says so now if there is no such object
  std::filesystem::create_directories(folder);
}

void ObservedRun::after_instant(TimeNs t) {
  const System::Opening& opening = system_.opening();
  const RequestStatus& status = opening.status;
  if (!observer_ && status.id != seen_ && opening.object.view() == object_) {
    seen_ = status.id;
    start_ = t;
    observer_.emplace(system_, object_, RunObserver::threshold(object_));
    observer_->start(t);
    observer_->write_to(folder_);
  }
  if (!observer_) return;
  observer_->sample(t);
  const bool ended = status.id != seen_ || status.outcome == RequestOutcome::kSucceeded ||
                     status.outcome == RequestOutcome::kFailed;
  if (ended) end(t, status);
}

void ObservedRun::end(TimeNs t, const RequestStatus& status) {
  observer_->finish();
  const RunResult r = observer_->result();
  observer_.reset();
  const bool claimed = status.id == seen_ && status.outcome == RequestOutcome::kSucceeded;
  // The threshold is the truth's; a controller that only believes in its success has failed.
  const bool opened = claimed && r.opened;
  const std::string reason = opened               ? ""
                             : claimed            ? "the simulator does not find it open"
                             : status.id != seen_ ? "another request followed"
                                                  : std::string(status.reason.view());
  const char* unit = r.revolute ? "rad" : "m";

  Json json = Json::object();
  json.add("object", object_).add("opened", opened).add("reason", reason);
  json.add("value", r.opened_value).add("range", r.range).add("unit", unit);
  json.add("time_s", r.opened ? r.time_s : NAN).add("end_s", to_seconds(t - start_));
  json.add("collisions", r.collisions).add("first_collision", r.first_collision);
  json.add("min_clearance_m", r.min_clearance_m).add("slip_m", r.slip_m);
  json.add("ee_path_m", r.ee_path_m);
  std::ofstream(folder_ / "summary.json") << json.str() << "\n";

  if (opened) {
    std::printf("opened %s: %.2f of %.2f %s in %.1f s, %d collisions\n", object_.c_str(),
                r.opened_value, r.range, unit, r.time_s, r.collisions);
  } else {
    std::printf("failed to open %s: %s; %.2f of %.2f %s, %d collisions\n", object_.c_str(),
                reason.c_str(), r.opened_value, r.range, unit, r.collisions);
  }
  std::fflush(stdout);
}

}  // namespace wb
