// wbctl: the daemon's command client. World: one ordinary thread, DDS only through Client; `replay`
// and `rt-test` need neither. Exit code: 0 done, 1 refused or failed (or wrong usage, or a replay
// that differs), 2 no daemon, no answer in time, a file that cannot be replayed, or an rt-test that
// says nothing.
#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <optional>
#include <string>

#include "core/config/config.hpp"
#include "daemon/json.hpp"
#include "daemon/replay.hpp"
#include "daemon/robot/robot_commands.hpp"
#include "daemon/service/client.hpp"
#include "daemon/wbctl/mpc_report.hpp"
#include "daemon/wbctl/progress.hpp"
#include "daemon/wbctl/rt_test.hpp"

namespace wb {
namespace {

constexpr int kDone = 0, kFailed = 1, kNoDaemon = 2;

struct Arguments {
  bool json = false;
  double timeout_s = 10;  // of silence
  std::optional<int> domain;
  std::string object;
  double fraction = 0;
  std::string tune = "get";  // or set, revert
  std::string weight;        // tune: its name; empty: all
  double value = 0;          // tune set
  std::string recording;
  double seconds = 10;  // of rt-test
  RobotImportArguments robot_import;
  RobotCheckArguments robot_check;
};

using SteadyClock = std::chrono::steady_clock;
double seconds_since(SteadyClock::time_point t) {
  return std::chrono::duration<double>(SteadyClock::now() - t).count();
}

volatile std::sig_atomic_t interrupted = 0;

int report(const Arguments& arguments, const Json& json, const std::string& message, int code) {
  if (arguments.json) std::printf("%s\n", json.str().c_str());
  if (!arguments.json || code != kDone) {
    std::fprintf(code == kDone ? stdout : stderr, "%s\n", message.c_str());
  }
  return code;
}

int report_silence(const Arguments& arguments, const std::string& verb,
                   const std::string& message) {
  return report(arguments,
                Json::object().add("verb", verb).add("outcome", "no answer").add("reason", message),
                "wbctl: " + message, kNoDaemon);
}

int report_no_daemon(const Arguments& arguments, const std::string& verb, int domain) {
  return report_silence(
      arguments, verb,
      "no wholebodyd found in DDS domain " + std::to_string(domain) +
          " (is it running, and with the same ROS_DOMAIN_ID and CYCLONEDDS_URI?)");
}

int report_end(const Arguments& arguments, const OperatorCommand& command, const OperatorAck& ack,
               double elapsed_s) {
  const bool good = ack.outcome == "succeeded";
  Json json = Json::object();
  json.add("verb", command.verb).add("object", command.object).add("outcome", ack.outcome);
  json.add("phase", ack.phase).add("reason", ack.reason);
  json.add("joint_value", ack.joint_value).add("joint_range", ack.joint_range);
  json.add("elapsed_s", elapsed_s);
  std::string message = command.verb + (command.object.empty() ? "" : " " + command.object) + ": " +
                        ack.outcome + (ack.reason.empty() ? "" : ": " + ack.reason);
  if (ack.joint_range > 0) {
    char joint[64];
    std::snprintf(joint, sizeof joint, ", joint at %.3f of %.3f", ack.joint_value, ack.joint_range);
    message += joint;
  }
  char elapsed[32];
  std::snprintf(elapsed, sizeof elapsed, " (%.1f s)", elapsed_s);
  return report(arguments, json, message + elapsed, good ? kDone : kFailed);
}

// Sends a command and waits for its end. Ctrl-C sends a stop once; the second one leaves.
int run_command(const Arguments& arguments, Client& client, const OperatorCommand& command) {
  const auto start = SteadyClock::now();
  if (!client.send(command)) {
    return report_silence(arguments, command.verb, "the command could not be sent");
  }
  Progress progress(arguments.json);
  std::optional<OperatorCommand> stop;
  bool answered = false;
  auto heard = start;
  for (;;) {
    client.wait(0.1);
    while (const auto ack = client.take_acknowledgement()) {
      if (ack->client != client.id()) continue;
      if (stop && ack->request_id == stop->request_id && ack->outcome == "refused") {
        std::fprintf(stderr, "wbctl: the stop was refused: %s\n", ack->reason.c_str());
      }
      if (ack->request_id != command.request_id) continue;
      answered = true;
      heard = SteadyClock::now();
      if (ack->final()) {
        progress.finish();
        return report_end(arguments, command, *ack, seconds_since(start));
      }
      progress.show(*ack, seconds_since(start));
    }
    // Once the request runs, the daemon's status shows that someone is still at work on it.
    if (client.take_status() && answered) heard = SteadyClock::now();
    if (interrupted > (stop ? 1 : 0)) {
      progress.finish();
      if (stop) return report_silence(arguments, command.verb, "left while stopping");
      std::fprintf(stderr, "wbctl: stopping (Ctrl-C again to leave at once)\n");
      stop = client.command("stop");
      client.send(*stop);
      answered = false;  // the end must now come in time
      heard = SteadyClock::now();
    }
    if (seconds_since(heard) > arguments.timeout_s) {
      progress.finish();
      return report_silence(arguments, command.verb,
                            std::string("wholebodyd does not answer any more") +
                                (answered || stop ? "" : " (the command was sent)"));
    }
  }
}

int run_status(const Arguments& arguments, Client& client) {
  const auto start = SteadyClock::now();
  std::optional<DaemonStatus> status;
  while (!(status = client.take_status())) {
    if (seconds_since(start) > arguments.timeout_s) {
      return report_silence(arguments, "status", "wholebodyd sends no status");
    }
    client.wait(0.1);
  }
  Json loops = Json::array();
  std::string table;
  char line[160];
  for (const auto& loop : status->loops) {
    loops.push(Json::object()
                   .add("name", loop.name)
                   .add("cycles", loop.cycles)
                   .add("overruns", loop.overruns)
                   .add("p50_us", loop.p50_us)
                   .add("p99_us", loop.p99_us)
                   .add("max_us", loop.max_us));
    std::snprintf(line, sizeof line,
                  "\n%-9s %llu cycles, %llu overruns, %.0f / %.0f / %.0f us (median, p99, largest)",
                  loop.name.c_str(), static_cast<unsigned long long>(loop.cycles),
                  static_cast<unsigned long long>(loop.overruns), loop.p50_us, loop.p99_us,
                  loop.max_us);
    table += line;
  }
  Json counters = Json::object();
  for (const auto& counter : status->counters) {
    counters.add(counter.name, counter.count);
    table += "\n" + counter.name + ": " + std::to_string(counter.count);
  }
  Json json = Json::object();
  json.add("mode", status->mode).add("phase", status->phase).add("object", status->object);
  json.add("outcome", status->outcome).add("reason", status->reason);
  json.add("joint_value", status->joint_value).add("joint_range", status->joint_range);
  json.add("base", Json::array().push(status->base[0]).push(status->base[1]).push(status->base[2]));
  json.add("gripper_opening_m", status->gripper_opening_m).add("stamp_ns", status->stamp_ns);
  json.add("loops", loops).add("counters", counters).add("mpc_trouble", status->mpc_trouble);
  if (!status->mpc_trouble.empty()) table += "\nmpc_trouble: " + status->mpc_trouble;

  std::string message = "mode      " + status->mode + "\nphase     " + status->phase;
  if (!status->outcome.empty()) {
    message += "\nrequest   " + (status->object.empty() ? "" : status->object + " ") +
               status->outcome + (status->reason.empty() ? "" : ": " + status->reason);
  }
  if (status->joint_range > 0) {
    std::snprintf(line, sizeof line, "\njoint     %.3f of %.3f", status->joint_value,
                  status->joint_range);
    message += line;
  }
  std::snprintf(line, sizeof line, "\nbase      x %.3f m, y %.3f m, yaw %.3f rad\ngripper   %.3f m",
                status->base[0], status->base[1], status->base[2], status->gripper_opening_m);
  return report(arguments, json, message + line + table, kDone);
}

// What a latched topic holds; none if nothing came in time.
template <class Value>
std::optional<Value> latched(const Arguments& arguments, Client& client,
                             std::optional<Value> (Client::*take)()) {
  const auto start = SteadyClock::now();
  std::optional<Value> value;
  while (!(value = (client.*take)()) && seconds_since(start) < arguments.timeout_s) {
    (void)client.take_status();
    client.wait(0.1);
  }
  return value;
}

int run_explain(const Arguments& arguments, Client& client) {
  const auto e = latched(arguments, client, &Client::take_explanation);
  if (!e) return report_silence(arguments, "explain", "nothing has been planned yet");
  return report(arguments, to_json(*e), to_text(*e), kDone);
}

int run_tune_get(const Arguments& arguments, Client& client) {
  const auto tuning = latched(arguments, client, &Client::take_tuning);
  if (!tuning) return report_silence(arguments, "tune", "wholebodyd sends no weights");
  for (const auto& w : tuning->weights) {
    if (arguments.weight.empty() || w.name == arguments.weight) {
      return report(arguments, to_json(*tuning, arguments.weight),
                    to_text(*tuning, arguments.weight), kDone);
    }
  }
  const std::string reason = "no weight '" + arguments.weight + "'; wbctl tune get lists them";
  return report(arguments, Json::object().add("outcome", "refused").add("reason", reason),
                "wbctl: " + reason, kFailed);
}

int run(const std::string& verb, const Arguments& arguments) {
  if (verb == "replay") return replay_main(arguments.recording, arguments.json);
  if (verb == "rt-test") return rt_test_main(arguments.seconds, arguments.json);
  const int domain = arguments.domain.value_or(domain_from_environment());
  Client client(domain, "wbctl");
  if (!client.wait_for_daemon(arguments.timeout_s)) {
    return report_no_daemon(arguments, verb, domain);
  }
  if (verb == "status") return run_status(arguments, client);
  if (verb == "open") {
    std::signal(SIGINT, [](int) { interrupted = interrupted + 1; });
  }
  if (verb == "explain") return run_explain(arguments, client);
  if (verb == "tune") {
    if (arguments.tune == "get") return run_tune_get(arguments, client);
    OperatorCommand command = client.command(arguments.tune == "set" ? "tune" : "revert");
    command.object = arguments.weight;
    if (arguments.tune == "set") command.values = {arguments.value};
    return run_command(arguments, client, command);
  }
  OperatorCommand command = client.command(verb);
  command.object = arguments.object;
  command.opened_fraction = arguments.fraction;
  return run_command(arguments, client, command);
}

}  // namespace
}  // namespace wb

int main(int argc, char** argv) {
  wb::Arguments arguments;
  CLI::App app("Command client of wholebodyd");
  app.require_subcommand(1);
  app.fallthrough();  // the options below may stand after the verb
  app.add_flag("--json", arguments.json, "print one JSON object");
  app.add_option("--timeout_s", arguments.timeout_s, "longest silence of the daemon")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--domain", arguments.domain, "DDS domain (default: ROS_DOMAIN_ID, or 0)")
      ->check(CLI::Range(0, 232));
  app.add_subcommand("status", "show mode, phase, loops and counters");
  CLI::App* open = app.add_subcommand("open", "open an object; Ctrl-C stops");
  open->add_option("object", arguments.object, "its name")->required();
  open->add_option("--fraction", arguments.fraction, "how far, of its range; 0 = its default")
      ->check(CLI::Range(0.0, 1.0));
  app.add_subcommand("stop", "stop what the robot is doing and stand still");
  app.add_subcommand("reset", "leave degraded, hold or settle");
  app.add_subcommand("explain", "what the MPC's newest solve did, and which of its terms compete");
  CLI::App* tune = app.add_subcommand("tune", "show or change the MPC's weights while it runs");
  tune->require_subcommand(1);
  tune->fallthrough();
  const auto tuning = [&](const char* name, const char* what) {
    CLI::App* sub = tune->add_subcommand(name, what);
    sub->fallthrough();
    return std::pair{sub, sub->add_option("name", arguments.weight, "as in mpc.yaml: term.key")};
  };
  tuning("get", "one weight, or all: value, configured, range");
  const auto [set, set_name] = tuning("set", "a weight, from the next solve on");
  set_name->required();
  set->add_option("value", arguments.value, "within its range")->required();
  tuning("revert", "one weight, or all, as configured");
  app.add_subcommand("replay", "run a recording's steps again and compare; needs no daemon")
      ->add_option("file", arguments.recording, "made by wholebodyd --record")
      ->required();
  app.add_subcommand("rt-test", "how punctually this computer wakes a 400 Hz loop; needs no daemon")
      ->add_option("--seconds", arguments.seconds, "how long to measure")
      ->check(CLI::Range(0.1, 86400.0))
      ->capture_default_str();
  CLI::App* robot = app.add_subcommand("robot", "import or check a robot; needs no daemon");
  robot->require_subcommand(1);
  wb::RobotImportArguments& imported = arguments.robot_import;
  CLI::App* importing = robot->add_subcommand("import", "make a robot's folder of a URDF");
  importing->add_option("file", imported.file, "the URDF")->required();
  importing->add_option("--name", imported.name, "of the robot and its folder")->required();
  importing->add_option("--into", imported.into, "where its folder goes")->capture_default_str();
  importing->add_option("--base", imported.base, "instead of guessing it")
      ->check(CLI::IsMember({"fixed", "differential_drive", "omnidirectional"}));
  importing->add_option("--end-effector", imported.end_effector, "link, instead of guessing it");
  importing->add_option("--package", imported.packages,
                        "folder of package:// URIs; may be repeated");
  importing->add_option("--samples", imported.samples, "postures tried")
      ->check(CLI::Range(100, 10000000))
      ->capture_default_str();
  importing->add_option("--seed", imported.seed, "of the sampling")->capture_default_str();
  importing->add_flag("--force", imported.force, "replace a folder that is there");
  wb::RobotCheckArguments& check = arguments.robot_check;
  CLI::App* checking = robot->add_subcommand("check", "prove that a robot can be controlled");
  checking->add_option("name", check.name, "of the robot, or its folder")->required();
  checking->add_option("--into", check.into, "where its folder is")->capture_default_str();
  checking->add_option("--samples", check.samples, "of each sampled check")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  checking->add_option("--seed", check.seed, "of the sampling")->capture_default_str();
  try {
    app.parse(argc, argv);
    imported.json = check.json = arguments.json;
    if (importing->parsed()) return wb::robot_import_main(imported);
    if (checking->parsed()) return wb::robot_check_main(check);
    if (tune->parsed()) arguments.tune = tune->get_subcommands().front()->get_name();
    return wb::run(app.get_subcommands().front()->get_name(), arguments);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : wb::kFailed;
  } catch (const wb::config::ConfigError& error) {
    std::fprintf(stderr, "wbctl: %s\n", error.what());
    return wb::kNoDaemon;
  }
}
