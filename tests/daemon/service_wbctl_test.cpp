// Facts about wbctl as a process: exit codes, what it prints, and that Ctrl-C stops the robot. The
// daemon is a Service in the test's process with the test as its controller.
#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <yaml-cpp/yaml.h>

#include <fstream>
#include <sstream>

#include "tests/daemon/service_fixture.hpp"

namespace wb {
namespace {

class WbctlTest : public ServiceTest {
 protected:
  void TearDown() override {
    if (child > 0) kill(child, SIGKILL), waitpid(child, nullptr, 0);
    std::remove(out_file.c_str());
  }

  void spawn(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), WB_WBCTL);
    arguments.insert(arguments.end(), {"--domain", std::to_string(domain())});
    std::vector<char*> argv;
    for (auto& a : arguments) argv.push_back(a.data());
    argv.push_back(nullptr);
    child = fork();
    if (child != 0) return;
    const int out = ::open(out_file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(out, STDOUT_FILENO);
    execv(argv[0], argv.data());
    _exit(127);
  }
  // Its exit code; -1 if it did not end in time.
  int exit_code() {
    int status = 0;
    if (!wait_until([&] { return waitpid(child, &status, WNOHANG) == child; }, 2 * kPatienceS)) {
      return -1;
    }
    child = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  std::string output() const {
    std::ostringstream text;
    text << std::ifstream(out_file).rdbuf();
    return text.str();
  }
  Request served_request() {
    Request request;
    EXPECT_TRUE(wait_until([&] { return requests.pop(request); }));
    return request;
  }
  void start_service() { service = std::make_unique<Service>(options(), ports()); }

  const std::string out_file = ::testing::TempDir() + "wbctl_" + std::to_string(getpid()) + ".out";
  pid_t child = 0;
};

TEST_F(WbctlTest, WithoutADaemonItSaysSoAndReturnsTwo) {
  spawn({"stop", "--timeout_s", "0.2", "--json"});
  EXPECT_EQ(exit_code(), 2);
  EXPECT_EQ(YAML::Load(output())["outcome"].as<std::string>(), "no answer");
}

TEST_F(WbctlTest, OpenShowsEachPhaseAndReturnsZeroOnSuccess) {
  start_service();
  spawn({"open", "drawer", "--fraction", "0.5"});
  const Request request = served_request();
  EXPECT_EQ(request.kind, RequestKind::kOpen);
  EXPECT_EQ(request.opened_fraction, 0.5);
  answer(request, RequestOutcome::kAccepted);
  answer(request, RequestOutcome::kRunning, kNow + 1, Phase::kApproach);
  answer(request, RequestOutcome::kRunning, kNow + 2, Phase::kManipulate);
  answer(request, RequestOutcome::kSucceeded, kNow + 3, Phase::kDone);
  EXPECT_EQ(exit_code(), 0);
  const std::string text = output();
  for (const char* part :
       {"approach", "manipulate", "joint at 0.125 of 0.500 (25 %)", "open drawer: succeeded"}) {
    EXPECT_NE(text.find(part), std::string::npos) << part << " in:\n" << text;
  }
  EXPECT_EQ(text.find('\r'), std::string::npos) << "lines are rewritten on a terminal only";
}

TEST_F(WbctlTest, FailureReturnsOneAndJsonGivesTheReason) {
  start_service();
  spawn({"open", "drawer", "--json"});
  answer(served_request(), RequestOutcome::kFailed, kNow, Phase::kFailed, "handle \"lost\"");
  EXPECT_EQ(exit_code(), 1);
  const YAML::Node json = YAML::Load(output());
  EXPECT_EQ(json["outcome"].as<std::string>(), "failed");
  EXPECT_EQ(json["reason"].as<std::string>(), "handle \"lost\"");
  EXPECT_EQ(json["joint_value"].as<double>(), 0.125);
}

TEST_F(WbctlTest, RefusalReturnsOneAndReachesNobody) {
  start_service();
  spawn({"open", "fridge", "--json"});
  EXPECT_EQ(exit_code(), 1);
  EXPECT_EQ(YAML::Load(output())["outcome"].as<std::string>(), "refused");
  EXPECT_EQ(requests.peek(), nullptr);
}

TEST_F(WbctlTest, CtrlCWhileOpeningSendsAStop) {
  start_service();
  spawn({"open", "oven"});
  const Request opening = served_request();
  answer(opening, RequestOutcome::kRunning, kNow, Phase::kManipulate);
  ASSERT_TRUE(wait_until([&] { return output().find("manipulate") != std::string::npos; }));
  kill(child, SIGINT);
  const Request stop = served_request();
  EXPECT_EQ(stop.kind, RequestKind::kStop);
  answer(stop, RequestOutcome::kSucceeded);
  answer(opening, RequestOutcome::kFailed, kNow + 1, Phase::kFailed, "stopped");
  EXPECT_EQ(exit_code(), 1);
}

TEST_F(WbctlTest, SilentControllerEndsInTwo) {
  start_service();
  spawn({"reset", "--timeout_s", "1"});
  EXPECT_EQ(served_request().kind, RequestKind::kReset);
  EXPECT_EQ(exit_code(), 2);
}

TEST_F(WbctlTest, StatusPrintsModeLoopsAndCountersAsJson) {
  ServiceSnapshot& s = snapshot.writing();
  s = {};
  s.state.mode = Mode::kReady;
  s.state.base = {1.5, 0, 0};
  s.loop_count = 1;
  s.loops[0] = {Name("control"), 400, 0, 50, 90, 700};
  s.counter_count = 1;
  s.counters[0] = {Name("frames"), 5};
  snapshot.publish();
  start_service();
  spawn({"status", "--json"});
  EXPECT_EQ(exit_code(), 0);
  const YAML::Node json = YAML::Load(output());
  EXPECT_EQ(json["mode"].as<std::string>(), "ready");
  EXPECT_EQ(json["base"][0].as<double>(), 1.5);
  EXPECT_EQ(json["loops"][0]["cycles"].as<int>(), 400);
  EXPECT_EQ(json["counters"]["frames"].as<int>(), 5);
}

TEST_F(WbctlTest, TuneSetsGetsAndReverts) {
  ServiceSnapshot& s = snapshot.writing();
  s = {};
  s.weights.revision = 4;
  s.weights.count = 1;
  s.weights.values[0] = 100;
  snapshot.publish();
  start_service();
  spawn({"tune", "set", "end_effector.position_pm2", "120"});
  const Request set = served_request();
  EXPECT_EQ(set.kind, RequestKind::kTune);
  EXPECT_EQ(set.weight, 0);
  EXPECT_EQ(set.value, 120);
  answer(set, RequestOutcome::kSucceeded);
  EXPECT_EQ(exit_code(), 0);
  spawn({"tune", "revert"});
  const Request revert = served_request();
  EXPECT_EQ(revert.kind, RequestKind::kRevert);
  EXPECT_EQ(revert.weight, -1);
  answer(revert, RequestOutcome::kSucceeded);
  EXPECT_EQ(exit_code(), 0);
  spawn({"tune", "get", "--json"});
  EXPECT_EQ(exit_code(), 0);
  const YAML::Node json = YAML::Load(output());
  EXPECT_EQ(json["revision"].as<int>(), 4);
  EXPECT_EQ(json["weights"][0]["name"].as<std::string>(), "end_effector.position_pm2");
  EXPECT_EQ(json["weights"][0]["value"].as<double>(), 100);
  EXPECT_EQ(json["weights"][0]["configured"].as<double>(), 80);
}

TEST_F(WbctlTest, TuneOfASafetyTermIsRefusedWithTheReason) {
  start_service();
  spawn({"tune", "set", "environment.mu_pm2", "1", "--json"});
  EXPECT_EQ(exit_code(), 1);
  const YAML::Node json = YAML::Load(output());
  EXPECT_EQ(json["outcome"].as<std::string>(), "refused");
  EXPECT_NE(json["reason"].as<std::string>().find("cannot be tuned"), std::string::npos);
  EXPECT_EQ(requests.peek(), nullptr);
}

TEST_F(WbctlTest, ExplainNamesTheTermsThatCompete) {
  snapshot.writing() = {};
  snapshot.publish();
  explanation.status = "converging";
  explanation.trouble = "none";
  explanation.cost = 5;
  explanation.terms = {{"end_effector", 4, 0.8, 0, 3}, {"environment", 1, 0.2, 0.01, 3}};
  explanation.competing = {{"end_effector", "environment", -0.94, "one against the other"}};
  explanation_pending = true;
  start_service();
  spawn({"explain", "--json"});
  EXPECT_EQ(exit_code(), 0);
  const YAML::Node json = YAML::Load(output());
  EXPECT_EQ(json["terms"].size(), 2u);
  EXPECT_EQ(json["terms"][1]["violation"].as<double>(), 0.01);
  EXPECT_EQ(json["competing"][0]["cosine"].as<double>(), -0.94);
  EXPECT_EQ(json["competing"][0]["text"].as<std::string>(), "one against the other");
  spawn({"explain"});
  EXPECT_EQ(exit_code(), 0);
  EXPECT_NE(output().find("one against the other"), std::string::npos) << output();
}

TEST_F(WbctlTest, WrongUsageReturnsOne) {
  spawn({"open"});
  EXPECT_EQ(exit_code(), 1);
}

}  // namespace
}  // namespace wb
