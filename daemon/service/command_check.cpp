#include "daemon/service/command_check.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>
#include <utility>

#include "core/config/closest.hpp"

namespace wb {
namespace {

constexpr std::array<std::pair<std::string_view, RequestKind>, 7> kVerbs{{
    {"open", RequestKind::kOpen},
    {"stop", RequestKind::kStop},
    {"reset", RequestKind::kReset},
    {"move_joints", RequestKind::kMoveJoints},
    {"move_base", RequestKind::kMoveBase},
    {"tune", RequestKind::kTune},
    {"revert", RequestKind::kRevert},
}};

// A text from the wire, fit for an operator's terminal.
std::string quoted(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }, '?');
  return "'" + text + "'";
}

CheckedCommand refuse(Refusal refusal, std::string reason) {
  return {refusal, std::move(reason), {}};
}

template <class... Parts>
CheckedCommand refuse(Refusal refusal, const Parts&... parts) {
  std::ostringstream text;
  (text << ... << parts);
  return refuse(refusal, text.str());
}

bool finite(const OperatorCommand& command) {
  return std::isfinite(command.opened_fraction) &&
         std::all_of(command.values.begin(), command.values.end(),
                     [](double v) { return std::isfinite(v); });
}

CheckedCommand check_open(const OperatorCommand& command, const CommandRules& rules) {
  if (!rules.objects.contains(command.object)) {
    std::string known;
    for (const auto& name : rules.objects) known += (known.empty() ? "" : ", ") + name;
    return refuse(
        Refusal::kUnknownObject,
        command.object.empty() ? "no object given" : "no object " + quoted(command.object),
        "; known: ", known.empty() ? "none" : known);
  }
  if (command.opened_fraction < 0 || command.opened_fraction > 1) {
    return refuse(Refusal::kOutOfRange, "opened_fraction ", command.opened_fraction,
                  " is outside 0 .. 1");
  }
  CheckedCommand checked;
  checked.request.object = Name(command.object);
  checked.request.opened_fraction = command.opened_fraction;
  return checked;
}

CheckedCommand check_joints(const OperatorCommand& command, const CommandRules& rules) {
  if (command.values.size() != rules.joints.size() || rules.joints.size() > kMaxJoints) {
    return refuse(Refusal::kWrongCount, "move_joints takes ", rules.joints.size(), " values, got ",
                  command.values.size());
  }
  CheckedCommand checked;
  checked.request.joint_count = static_cast<int>(command.values.size());
  for (std::size_t i = 0; i < command.values.size(); ++i) {
    const double q = command.values[i];
    if (q < rules.joints[i].lower || q > rules.joints[i].upper) {
      return refuse(Refusal::kOutOfRange, "joint ", i, " at ", q, " is outside ",
                    rules.joints[i].lower, " .. ", rules.joints[i].upper);
    }
    checked.request.q[i] = q;
  }
  return checked;
}

CheckedCommand check_base(const OperatorCommand& command, const CommandRules& rules) {
  if (!rules.mobile_base) return refuse(Refusal::kUnknownVerb, "this robot's base is fixed");
  if (command.values.size() != 3) {
    return refuse(Refusal::kWrongCount, "move_base takes x, y, yaw, got ", command.values.size(),
                  " values");
  }
  const double reach = std::max(std::abs(command.values[0]), std::abs(command.values[1]));
  if (reach > rules.base_reach_m) {
    return refuse(Refusal::kOutOfRange, "base goal is ", reach, " m away, more than ",
                  rules.base_reach_m);
  }
  if (std::abs(command.values[2]) > std::numbers::pi) {
    return refuse(Refusal::kOutOfRange, "yaw ", command.values[2], " is outside -pi .. pi");
  }
  CheckedCommand checked;
  std::copy_n(command.values.begin(), 3, checked.request.base.begin());
  return checked;
}

CheckedCommand unknown_weight(const std::string& name, const CommandRules& rules) {
  const std::string term = name.substr(0, name.find('.'));
  const bool tunable = std::any_of(rules.weights.begin(), rules.weights.end(),
                                   [&](const auto& w) { return w.name.starts_with(term + "."); });
  if (rules.terms.contains(term) && !tunable) {
    return refuse(Refusal::kUnknownWeight, quoted(name),
                  " cannot be tuned: limits and safety terms are fixed at start");
  }
  std::vector<std::string> known;
  for (const WeightInfo& w : rules.weights) known.push_back(w.name);
  const std::string guess = config::closest(name, known);
  return refuse(Refusal::kUnknownWeight, "no weight ", quoted(name),
                guess.empty() ? "; wbctl tune get lists them" : "; did you mean '" + guess + "'?");
}

CheckedCommand check_tuning(const OperatorCommand& command, const CommandRules& rules,
                            RequestKind kind) {
  CheckedCommand checked;
  const std::size_t values = kind == RequestKind::kTune ? 1 : 0;
  if (command.values.size() != values) {
    return refuse(Refusal::kWrongCount, command.verb, " takes ", values, " values, got ",
                  command.values.size());
  }
  if (kind == RequestKind::kRevert && command.object.empty()) return checked;
  const auto weight = std::find_if(rules.weights.begin(), rules.weights.end(),
                                   [&](const auto& w) { return w.name == command.object; });
  if (weight == rules.weights.end()) return unknown_weight(command.object, rules);
  checked.request.weight = static_cast<int>(weight - rules.weights.begin());
  if (kind == RequestKind::kRevert) return checked;
  const double value = command.values[0];
  if (value < weight->low || value > weight->high) {
    return refuse(Refusal::kOutOfRange, weight->name, " at ", value, " is outside ", weight->low,
                  " .. ", weight->high);
  }
  checked.request.value = value;
  return checked;
}

}  // namespace

std::string_view to_string(Refusal refusal) {
  static constexpr std::array<std::string_view, kRefusalKinds> kNames{
      "none",           "no client",  "unknown verb", "unknown object",
      "unknown weight", "not finite", "out of range", "wrong count",
      "stale",          "duplicate",  "busy"};
  return kNames[static_cast<std::size_t>(refusal)];
}

CheckedCommand check_command(const OperatorCommand& command, const CommandRules& rules,
                             std::int64_t now_ros_ns) {
  if (command.client.empty()) return refuse(Refusal::kNoClient, "no client name");
  const auto verb = std::find_if(kVerbs.begin(), kVerbs.end(),
                                 [&](const auto& v) { return v.first == command.verb; });
  if (verb == kVerbs.end()) {
    return refuse(Refusal::kUnknownVerb, "no verb ", quoted(command.verb),
                  "; known: open, stop, reset, move_joints, move_base, tune, revert");
  }
  const RequestKind kind = verb->second;
  if (!finite(command)) return refuse(Refusal::kNotFinite, "a number is not finite");
  if (kind != RequestKind::kStop) {
    // Compared without subtracting: the stamp may be any 64-bit number.
    if (command.stamp_ns < now_ros_ns - rules.age_max_ns) {
      return refuse(Refusal::kStale, "stamp is older than ", to_seconds(rules.age_max_ns), " s");
    }
    if (command.stamp_ns > now_ros_ns + rules.future_max_ns) {
      return refuse(Refusal::kStale, "stamp is from the future: check the clocks");
    }
  }

  CheckedCommand checked;
  if (kind == RequestKind::kOpen) checked = check_open(command, rules);
  if (kind == RequestKind::kMoveJoints) checked = check_joints(command, rules);
  if (kind == RequestKind::kMoveBase) checked = check_base(command, rules);
  if (tunes(kind)) checked = check_tuning(command, rules, kind);
  if (checked.refusal == Refusal::kNone) checked.request.kind = kind;
  return checked;
}

}  // namespace wb
