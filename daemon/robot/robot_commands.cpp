#include "daemon/robot/robot_commands.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include "core/model/import/urdf_import.hpp"
#include "daemon/json.hpp"
#include "daemon/robot/robot_check.hpp"

namespace wb {
namespace {

namespace fs = std::filesystem;

ImportOptions options_of(const RobotImportArguments& a) {
  ImportOptions out;
  out.name = a.name;
  if (!a.base.empty()) out.structure.base = imported_base(a.base);
  out.structure.end_effector = a.end_effector;
  out.packages = a.packages;
  out.sampling = {a.samples, static_cast<std::uint64_t>(a.seed)};
  return out;
}

// Written beside its place and moved there whole, so that a refusal leaves nothing behind.
ImportReport import_into(const RobotImportArguments& a) {
  const bool plain = std::all_of(a.name.begin(), a.name.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-';
  });
  if (a.name.empty() || !plain) {
    throw std::runtime_error("the name '" + a.name + "' must be of letters, digits, _ and -");
  }
  const fs::path folder = a.into / a.name;
  if (fs::exists(folder) && !a.force) {
    throw std::runtime_error(folder.string() + " is there already; --force replaces it");
  }
  const fs::path draft = a.into / ("." + a.name + ".import" + std::to_string(getpid()));
  fs::create_directories(draft);
  try {
    ImportReport report = import_urdf(a.file, draft, options_of(a));
    fs::remove_all(folder);
    fs::rename(draft, folder);
    report.folder = folder;
    return report;
  } catch (...) {
    fs::remove_all(draft);
    throw;
  }
}

int refuse(const char* verb, bool json, const std::string& reason) {
  if (json) {
    std::printf("%s\n", Json::object()
                            .add("verb", verb)
                            .add("outcome", "refused")
                            .add("reason", reason)
                            .str()
                            .c_str());
  }
  std::fprintf(stderr, "wbctl: %s\n", reason.c_str());
  return 2;
}

}  // namespace

int robot_import_main(const RobotImportArguments& a) {
  ImportReport r;
  try {
    r = import_into(a);
  } catch (const std::exception& error) {
    return refuse("robot import", a.json, error.what());
  }
  if (a.json) {
    Json notes = Json::array();
    for (const std::string& note : r.notes) notes.push(Json::object().add("note", note));
    Json json = Json::object();
    json.add("verb", "robot import").add("outcome", "succeeded").add("folder", r.folder.string());
    json.add("base", to_string(r.structure.base)).add("end_effector", r.structure.end_effector);
    json.add("joints", static_cast<int>(r.structure.joints.size()));
    json.add("capsules", r.capsules).add("capsule_coverage", r.capsule_fit.coverage);
    json.add("capsule_overhang_m", r.capsule_fit.overhang_m);
    json.add("spheres", r.spheres).add("sphere_coverage", r.sphere_fit.coverage);
    json.add("sphere_overhang_m", r.sphere_fit.overhang_m);
    json.add("pairs", r.pairs).add("pairs_apart", r.apart).add("pairs_always_near", r.always_near);
    json.add("contacts_excluded", r.excluded);
    json.add("stowed_radius_m", r.postures.stowed_radius_m).add("notes", notes);
    std::printf("%s\n", json.str().c_str());
    return 0;
  }
  for (const std::string& note : r.notes) std::printf("guessed  %s\n", note.c_str());
  std::printf("capsules %d, %.1f %% of the surface inside, overhang up to %.0f mm\n", r.capsules,
              100 * r.capsule_fit.coverage, 1000 * r.capsule_fit.overhang_m);
  std::printf("spheres  %d, %.1f %% of the surface inside, overhang up to %.0f mm\n", r.spheres,
              100 * r.sphere_fit.coverage, 1000 * r.sphere_fit.overhang_m);
  std::printf("pairs    %d kept, %d kept apart by the joints, %d near by shape\n", r.pairs, r.apart,
              r.always_near);
  std::printf("stowed   within %.2f m, pairs %.0f mm apart; ready: hand at %.2f, %.2f, %.2f m\n",
              r.postures.stowed_radius_m, 1000 * r.postures.stowed_distance_m,
              r.postures.p_BE_ready.x(), r.postures.p_BE_ready.y(), r.postures.p_BE_ready.z());
  std::printf("written  %s; next: wbctl robot check %s\n", r.folder.c_str(), r.folder.c_str());
  return 0;
}

int robot_check_main(const RobotCheckArguments& a) {
  const fs::path folder =
      a.name.find('/') == std::string::npos ? a.into / a.name : fs::path(a.name);
  const std::vector<CheckLine> lines =
      check_robot(folder, {a.samples, static_cast<unsigned>(a.seed)});
  const bool good = std::all_of(lines.begin(), lines.end(), [](auto& l) { return l.ok; });
  Json checks = Json::array();
  for (const CheckLine& l : lines) {
    if (!a.json) {
      std::printf("%-6s %-13s %.3g%s%s  %s\n", l.ok ? "ok" : "failed", l.name.c_str(), l.value,
                  l.unit.empty() ? "" : " ", l.unit.c_str(), l.text.c_str());
    }
    Json check = Json::object();
    check.add("name", l.name).add("ok", l.ok).add("value", l.value).add("unit", l.unit);
    checks.push(check.add("text", l.text));
  }
  if (a.json) {
    Json json = Json::object();
    json.add("verb", "robot check").add("robot", a.name).add("ok", good).add("checks", checks);
    std::printf("%s\n", json.str().c_str());
  }
  return good ? 0 : 1;
}

}  // namespace wb
