// wb-plant: the simulated robot as a process of its own, behind CiA 402 drives on CAN or behind
// DDS, in time that the bus paces or in real time. Its joints stop by the drives' own time-outs
// when the master is gone. Exit code: 0 ended by a signal, 1 an error, named on stderr.
#include <sys/mman.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <memory>
#include <optional>

#include "core/rt/executor.hpp"
#include "drivers/plant/can_side.hpp"
#include "drivers/plant/dds_side.hpp"
#include "drivers/plant/gripper_side.hpp"
#include "drivers/plant/plant_config.hpp"

namespace {

std::atomic<bool> stopping{false};
void on_signal(int) { stopping = true; }

using wb::TimeNs;

// One line for each 10 ms of the plant's time: where everything is, and how fast.
class Journal {
 public:
  Journal(const std::string& file, const wb::plant::SimulatedRobot& robot) : robot_(robot) {
    if (file.empty()) return;
    file_.reset(std::fopen(file.c_str(), "w"));
    if (!file_) throw std::runtime_error("cannot write " + file);
    std::fprintf(file_.get(), "t_s,base_x_m,base_y_m");
    for (std::uint32_t i = 0; i < robot.description().joint_count; ++i)
      std::fprintf(file_.get(), ",%s,%s_speed", robot.description().joints[i].name,
                   robot.description().joints[i].name);
    std::fprintf(file_.get(), ",commanded\n");
  }
  void write() {
    if (!file_ || robot_.now() < next_) return;
    next_ = robot_.now() + 10'000'000;
    const wb_sim_pose base = robot_.truth().base_pose(robot_.driver());
    std::fprintf(file_.get(), "%.4f,%.6f,%.6f", wb::to_seconds(robot_.now()), base.p[0], base.p[1]);
    int commanded = 0;
    for (std::uint32_t i = 0; i < robot_.description().joint_count; ++i) {
      const int joint = static_cast<int>(i);
      std::fprintf(file_.get(), ",%.6f,%.6f", robot_.position(joint), robot_.velocity(joint));
      commanded += robot_.target(joint).kind != wb::plant::JointTarget::Kind::kBrake;
    }
    std::fprintf(file_.get(), ",%d\n", commanded);
    std::fflush(file_.get());
  }

 private:
  struct Close {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  const wb::plant::SimulatedRobot& robot_;
  std::unique_ptr<std::FILE, Close> file_;
  TimeNs next_ = 0;
};

struct Plant {
  wb::plant::SimulatedRobot robot;
  std::optional<wb::plant::CanSide> can;
  std::optional<wb::plant::DdsSide> dds;
  std::optional<wb::plant::GripperSide> gripper;
  Journal journal;

  Plant(const wb::plant::Config& config, const std::string& journal_file)
      : robot(config.sim, config.folder), journal(journal_file, robot) {
    if (config.can) can.emplace(robot, *config.can);
    if (config.dds) dds.emplace(robot, *config.dds);
    if (!config.gripper_port.empty())
      gripper.emplace(robot, config.gripper_port, config.gripper_opening_max_m);
  }
};

// The bus's ticks move the plant.
void run_paced(Plant& p) {
  constexpr int kWait_ms = 1;  // for one side, while the other may have something
  while (!stopping) {
    if (p.can) p.can->serve(kWait_ms);
    if (p.dds) p.dds->spin(p.can ? 1'000'000 * kWait_ms : 100'000'000);
    if (p.gripper) p.gripper->exchange();
    p.journal.write();
  }
}

void run_real_time(Plant& p) {
  constexpr TimeNs kTurn_ns = 500'000;
  // A stall longer than this is left out of the plant's time.
  constexpr TimeNs kCatchUp_ns = 25'000'000;
  (void)mlockall(MCL_CURRENT | MCL_FUTURE);
  TimeNs start = wb::RealTime::monotonic();
  for (TimeNs next = start; !stopping;) {
    const TimeNs now = wb::RealTime::monotonic();
    start += std::max<TimeNs>(0, now - start - p.robot.now() - kCatchUp_ns);
    if (p.can) {
      p.can->run_to(now, now - start);
    } else {
      p.robot.advance(now - start);
    }
    if (p.gripper) p.gripper->exchange();
    if (p.dds) {
      p.dds->spin(0);
      p.dds->publish();
    }
    p.journal.write();
    next = std::max(next + kTurn_ns, wb::RealTime::monotonic());
    const timespec at{next / wb::kNanosPerSecond, next % wb::kNanosPerSecond};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr);
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::string config_file, journal;
  CLI::App app{"The simulated robot behind CAN or DDS"};
  app.add_option("--config", config_file, "the plant's own file (plant_can.yaml, plant_dds.yaml)")
      ->required();
  app.add_option("--journal", journal, "write where the joints are to this file (CSV)");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 1;
  }
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  try {
    const wb::plant::Config config = wb::plant::Config::load(config_file);
    Plant plant(config, journal);
    const bool paced = config.can ? config.can->paced() : config.dds->paced;
    std::fprintf(stderr, "wb-plant: %s, %s\n", plant.robot.description().name,
                 paced ? "paced by the bus" : "real time");
    paced ? run_paced(plant) : run_real_time(plant);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "wb-plant: %s\n", e.what());
    return 1;
  }
  return 0;
}
