// What a mapping update costs, in equivalent milliseconds (DEFINITIONS.md): four and five frames
// and the transform, with the sweep interleaved. Prints median, p99 and the sweep; asserts nothing.
// Usage: mapping_probe [updates]
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <random>

#include "bench/sweep.hpp"
#include "mapping/distance_transform.hpp"
#include "mapping/mapper.hpp"
#include "tests/mapping/scene.hpp"

namespace {

using namespace wb;

double cpu_ms() {
  timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

double quantile(std::vector<double> v, double q) {
  std::sort(v.begin(), v.end());
  return v[static_cast<std::size_t>(q * static_cast<double>(v.size() - 1))];
}

void report(const char* name, const std::vector<double>& ms, double scale) {
  std::printf("%-28s p50 %6.2f  p99 %6.2f  max %6.2f equivalent ms\n", name,
              scale * quantile(ms, 0.5), scale * quantile(ms, 0.99), scale * quantile(ms, 1.0));
}

// Kitchen-like: cabinets along a wall, an island, a table with legs, a person.
test::Scene kitchen() {
  test::Scene s;
  s.room = {{-2.5, -2.5, 0.0}, {2.5, 2.5, 2.5}};
  for (int i = 0; i < 6; ++i) {
    s.boxes.push_back({{-1.8 + 0.6 * i, 1.9, 0.0}, {-1.22 + 0.6 * i, 2.5, 0.9}});
    s.boxes.push_back({{-1.8 + 0.6 * i, 2.1, 1.4}, {-1.22 + 0.6 * i, 2.5, 2.1}});
  }
  s.boxes.push_back({{-1.9, -1.9, 0.70}, {-0.9, -1.1, 0.74}});
  for (const double x : {-1.87, -0.93}) {
    for (const double y : {-1.87, -1.13})
      s.boxes.push_back({{x - 0.02, y - 0.02, 0}, {x + 0.02, y + 0.02, 0.7}});
  }
  s.boxes.push_back({{1.2, -1.4, 0.0}, {1.6, -1.0, 1.75}});
  return s;
}

}  // namespace

int main(int argc, char** argv) {
  const int updates = argc > 1 ? std::atoi(argv[1]) : 300;
  const auto model = std::make_shared<const RobotModel>(
      RobotConfig::load(std::filesystem::path(WB_SOURCE_DIR) / "config/robots/mabi_mobile"));
  Mapper mapper(model);
  DistanceField field = mapper.make_field();
  const bench::Sweep sweep;
  std::mt19937 noise(1);
  test::Scene scene = kitchen();

  std::vector<double> sweeps, four, five, none, push;
  double checksum = 0;
  RobotState state;
  state.joint_count = model->joints();
  for (int j = 0; j < model->joints(); ++j) state.q[j] = model->config().stowed[j];
  std::vector<DepthFrame> frames(model->config().cameras.size());
  for (int n = 0; n < updates; ++n) {
    for (int tick = 0; tick < 27; ++tick) {
      state.t_ns += 2'500'000;
      state.base = {0.8 * std::sin(0.02 * n), 0.8 * std::cos(0.02 * n), 0.02 * n};
      const double start = cpu_ms();
      mapper.push_state(state);
      push.push_back(cpu_ms() - start);
    }
    std::array<double, kMaxStates> x{};
    std::copy_n(state.base.begin(), 3, x.begin());
    std::copy_n(state.q.begin(), model->joints(), x.begin() + 3);
    RobotModel::Data data;
    model->forward_kinematics(x.data(), data);
    scene.robot = test::robot_tubes(*model, data);
    std::vector<const DepthFrame*> pointers;
    for (std::size_t c = 0; c < frames.size(); ++c) {
      frames[c].camera = static_cast<int>(c);
      frames[c].t_ns = state.t_ns;
      frames[c].intrinsics = model->config().cameras[c].intrinsics;
      test::render(scene, model->X_WF(model->frame(model->config().cameras[c].name), data),
                   frames[c], &noise);
      pointers.push_back(&frames[c]);
    }
    double start = cpu_ms();
    checksum += sweep.run();
    sweeps.push_back(cpu_ms() - start);

    const auto measure = [&](std::span<const DepthFrame* const> some, std::vector<double>& into) {
      const double begin = cpu_ms();
      checksum += mapper.update(some, field).occupied;
      into.push_back(cpu_ms() - begin);
    };
    measure({pointers.data(), 4}, four);
    measure(pointers, five);
    measure({}, none);

    start = cpu_ms();
    checksum += sweep.run();
    sweeps.push_back(cpu_ms() - start);
  }
  const double scale = bench::kSweepReferenceMs / quantile(sweeps, 0.5);
  std::printf("sweep p50 %.3f p99 %.3f ms; checksum %g\n", quantile(sweeps, 0.5),
              quantile(sweeps, 0.99), checksum);
  report("update, 4 frames", four, scale);
  report("update, all cameras", five, scale);
  report("update, no frame (transform)", none, scale);
  report("push_state", push, scale);
  return 0;
}
