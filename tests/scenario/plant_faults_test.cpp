// The master dies, hangs or spins while the robot moves: the plant stops by its own time-out, and
// a daemon that is started again does not move it. In real time, over CAN and over DDS. What is
// measured is the plant's own journal: distances and times on its clock; no wall-clock time is
// asserted, since the machine may be busy.
#include <cmath>
#include <optional>

#include "daemon/service/client.hpp"
#include "tests/scenario/plant_fixture.hpp"
#include "tests/scenario/spin.hpp"

namespace wb {
namespace {

using test::contents;
using test::Process;

// Bounds that only a failure reaches.
constexpr double kPatience_s = 30;
// Of the daemon's ordinary threads, DDS among them: on a busy machine the robot would often settle.
constexpr int kDaemonPriority = 50;

// A line of the plant's journal.
struct Entry {
  double t_s = 0, x_m = 0, y_m = 0;
  std::vector<double> position, speed;  // of the joints, wheels last
  int commanded = 0;                    // joints that follow somebody

  double fastest() const {
    double v = 0;
    for (const double s : speed) v = std::max(v, std::abs(s));
    return v;
  }
  // Largest of any joint's [rad].
  double turned_since(const Entry& before) const {
    double d = 0;
    for (std::size_t i = 0; i + 2 < position.size(); ++i)  // the wheels show in the base
      d = std::max(d, std::abs(position[i] - before.position[i]));
    return d;
  }
  double driven_since(const Entry& before) const {
    return std::hypot(x_m - before.x_m, y_m - before.y_m);
  }
};

std::vector<Entry> read_journal(const test::fs::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);  // the head
  std::vector<Entry> out;
  while (std::getline(in, line)) {
    if (in.eof()) break;  // still being written
    std::istringstream fields(line);
    std::vector<double> v;
    std::string field;
    while (std::getline(fields, field, ',')) v.push_back(std::stod(field));
    if (v.size() < 4) continue;
    Entry e{v[0], v[1], v[2], {}, {}, static_cast<int>(v.back())};
    for (std::size_t i = 3; i + 2 < v.size(); i += 2) {
      e.position.push_back(v[i]);
      e.speed.push_back(v[i + 1]);
    }
    out.push_back(std::move(e));
  }
  return out;
}

class PlantFaults : public test::PlantTest {
 protected:
  void start(bool can) {
    start_plant({.can = can, .mode = "csp", .paced = false});
    start_daemon();
  }
  void start_daemon() {
    daemon_ = std::make_unique<Process>(
        std::vector<std::string>{WB_WHOLEBODYD, "--config", daemon_file()}, folder_ / "wholebodyd",
        kDaemonPriority);
    client_ = std::make_unique<Client>(domain_, "test");
    ASSERT_TRUE(client_->wait_for_daemon(kPatience_s)) << said();
  }
  std::string said() const { return contents(folder_ / "wholebodyd.err") + plant_said(); }

  bool wait_until(const std::function<bool()>& condition) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
    while (!condition()) {
      if (std::chrono::steady_clock::now() > end) return false;
      client_->wait(0.05);
      while (const auto ack = client_->take_acknowledgement())
        if (ack->request_id == asked_ && ack->final()) outcome_ = ack->outcome + ": " + ack->reason;
    }
    return true;
  }
  std::vector<Entry> journal() const { return read_journal(folder_ / "journal.csv"); }
  bool moving(double radps) {
    const auto lines = journal();
    return !lines.empty() && lines.back().fastest() > radps;
  }
  // Has stood for half a second of its own time.
  bool stands() {
    const auto lines = journal();
    if (lines.size() < 50) return false;
    for (auto e = lines.end() - 50; e != lines.end(); ++e) {
      if (e->fastest() > 0.02) return false;
    }
    return true;
  }
  void ask(const std::string& verb, const std::string& object = "") {
    OperatorCommand command = client_->command(verb);
    command.object = object;
    asked_ = command.request_id;
    outcome_.clear();
    client_->send(command);
  }
  // Resets (again, where a busy machine made the daemon settle) and opens, until the robot moves.
  bool set_in_motion() {
    for (int attempt = 0; attempt < 5; ++attempt) {
      ask("reset");
      if (!wait_until([&] { return !outcome_.empty(); })) return false;
      if (!outcome_.starts_with("succeeded")) continue;
      ask("open", "drawer_1");
      if (wait_until([&] { return moving(1.0) || !outcome_.empty(); }) && moving(1.0)) return true;
    }
    return false;
  }

  // The last thing that the daemon's process did happened before this line of the journal.
  void expect_stop(const char* what, const Entry& before) {
    ASSERT_TRUE(wait_until([&] { return stands(); })) << what << ": the plant goes on";
    const auto lines = journal();
    // When it came to rest.
    const Entry* rest = nullptr;
    for (const Entry& e : lines) {
      if (e.t_s < before.t_s) continue;
      if (e.fastest() > 0.02)
        rest = nullptr;
      else if (!rest)
        rest = &e;
    }
    ASSERT_NE(rest, nullptr);
    const Entry& last = lines.back();
    std::printf(
        "%s: stood %.2f s of the plant's time later, base %.0f mm, joints %.3f rad further\n", what,
        rest->t_s - before.t_s, 1e3 * last.driven_since(before), last.turned_since(before));
    // At 1 m/s, half a second (heartbeat, time-out and braking) is half a metre.
    EXPECT_LT(last.driven_since(before), 0.5);
    EXPECT_LT(last.turned_since(before), 0.6);
  }
  void expect_no_motion_from_a_new_daemon() {
    daemon_.reset();
    client_.reset();
    const Entry before = journal().back();
    start_daemon();
    const double until = journal().back().t_s + 1;
    ASSERT_TRUE(wait_until([&] { return journal().back().t_s > until; }));
    EXPECT_LT(journal().back().driven_since(before), 0.002);
    EXPECT_LT(journal().back().turned_since(before), 0.002);
  }

  // By a signal; 0: the control thread spins, while all others (the buses' too) go on.
  void dies(bool can, int signal, const char* what) {
    start(can);
    ASSERT_TRUE(set_in_motion()) << outcome_ << said();
    // Looked up before, since that takes a while.
    const pid_t control = test::find_thread(daemon_->id(), "control");
    const std::uint64_t loop = signal == 0 ? test::find_endless_loop(daemon_->id()) : 0;
    ASSERT_TRUE(moving(0.3));
    const Entry before = journal().back();
    if (signal != 0) {
      daemon_->send(signal);
    } else {
      ASSERT_TRUE(test::make_spin(control, loop));
    }
    expect_stop(what, before);
    expect_no_motion_from_a_new_daemon();
  }

  std::unique_ptr<Process> daemon_;
  std::unique_ptr<Client> client_;
  std::uint64_t asked_ = 0;
  std::string outcome_;
};

TEST_F(PlantFaults, StopsOverCanWhenTheDaemonIsKilled) { dies(true, SIGKILL, "CAN, killed"); }
TEST_F(PlantFaults, StopsOverCanWhenTheDaemonHangs) { dies(true, SIGSTOP, "CAN, stopped"); }
TEST_F(PlantFaults, StopsOverCanWhenTheControlThreadSpins) { dies(true, 0, "CAN, spinning"); }
TEST_F(PlantFaults, StopsOverDdsWhenTheDaemonIsKilled) { dies(false, SIGKILL, "DDS, killed"); }
TEST_F(PlantFaults, StopsOverDdsWhenTheDaemonHangs) { dies(false, SIGSTOP, "DDS, stopped"); }
TEST_F(PlantFaults, StopsOverDdsWhenTheControlThreadSpins) { dies(false, 0, "DDS, spinning"); }

}  // namespace
}  // namespace wb
