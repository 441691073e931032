#include "daemon/wbctl/mpc_report.hpp"

#include <cstdio>

namespace wb {
namespace {

template <class... Values>
std::string format(const char* how, Values... values) {
  char text[200];
  std::snprintf(text, sizeof text, how, values...);
  return text;
}

}  // namespace

Json to_json(const DaemonExplanation& e) {
  Json terms = Json::array(), competing = Json::array();
  for (const auto& t : e.terms) {
    terms.push(Json::object()
                   .add("name", t.name)
                   .add("cost", t.cost)
                   .add("share", t.share)
                   .add("violation", t.violation)
                   .add("pull", t.pull));
  }
  for (const auto& c : e.competing) {
    competing.push(Json::object()
                       .add("first", c.first)
                       .add("second", c.second)
                       .add("cosine", c.cosine)
                       .add("text", c.text));
  }
  return Json::object()
      .add("status", e.status)
      .add("trouble", e.trouble)
      .add("step", e.step)
      .add("cpu_ms", e.cpu_ms)
      .add("cost", e.cost)
      .add("weights_revision", e.weights_revision)
      .add("stamp_ns", e.stamp_ns)
      .add("terms", terms)
      .add("competing", competing);
}

std::string to_text(const DaemonExplanation& e) {
  std::string out = "status    " + e.status;
  if (e.trouble != "none") out += ", " + e.trouble;
  out += format("\nstep      %.3g, %.2f ms of CPU time, weights revision %llu", e.step, e.cpu_ms,
                static_cast<unsigned long long>(e.weights_revision));
  out += format("\ncost      %.4g\n\n%-20s %10s %7s %11s %10s", e.cost, "term", "cost", "share",
                "violation", "pull");
  for (const auto& t : e.terms) {
    out += format("\n%-20s %10.4g %5.1f %% %11.3g %10.3g", t.name.c_str(), t.cost, 100 * t.share,
                  t.violation, t.pull);
  }
  out += e.competing.empty() ? "\n\nno terms compete" : "\n";
  for (const auto& c : e.competing) out += "\n" + c.text;
  return out;
}

Json to_json(const DaemonTuning& tuning, const std::string& only) {
  Json weights = Json::array();
  for (const auto& w : tuning.weights) {
    if (!only.empty() && w.name != only) continue;
    weights.push(Json::object()
                     .add("name", w.name)
                     .add("value", w.value)
                     .add("configured", w.configured)
                     .add("low", w.low)
                     .add("high", w.high));
  }
  return Json::object().add("revision", tuning.revision).add("weights", weights);
}

std::string to_text(const DaemonTuning& tuning, const std::string& only) {
  std::string out = format("%-36s %10s %10s  %s", "weight", "value", "configured", "range");
  for (const auto& w : tuning.weights) {
    if (!only.empty() && w.name != only) continue;
    out += format("\n%-36s %10.4g %10.4g  %.3g .. %.3g", w.name.c_str(), w.value, w.configured,
                  w.low, w.high);
  }
  return out;
}

}  // namespace wb
