// Developer's tool: a picture of a simulated kitchen as PPM, and what a step and a frame cost.
// sim_view OUT.ppm [PLUGIN CONFIG [OBJECT VALUE]...]
#include <cstdio>
#include <ctime>
#include <exception>
#include <fstream>

#include "sim_driver.hpp"

namespace {

double thread_cpu_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

void picture(const wb::test::SimDriver& sim, const std::string& file, const wb_sim_pose* pose,
             double width_rad) {
  constexpr int kWidth = 1280, kHeight = 960;
  std::vector<std::uint8_t> rgb(3 * kWidth * kHeight);
  const double start = thread_cpu_us();
  sim.view().render(sim.get(), kWidth, kHeight, pose, width_rad, rgb.data());
  std::printf("picture %.0f ms\n", 1e-3 * (thread_cpu_us() - start));
  std::ofstream(file, std::ios::binary) << "P6 " << kWidth << ' ' << kHeight << " 255\n"
                                        << std::string(rgb.begin(), rgb.end());
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2)
    throw std::runtime_error("usage: sim_view OUT.ppm [PLUGIN CONFIG [OBJECT VALUE]...]");
  using namespace wb;
  test::SimDriver sim(
      argc > 2 ? argv[2]
               : test::sim_config("spawn: {x_m: -0.1, y_m: 0.9, yaw_rad: 0.0, posture: ready}"));
  for (int i = 3; i + 1 < argc; i += 2)
    sim.fault().set_object(sim.get(), sim.object_index(argv[i]), std::stod(argv[i + 1]));

  const double start = thread_cpu_us();
  constexpr double kSeconds = 4;
  sim.advance(from_seconds(kSeconds));
  const double cost = 1e-6 * (thread_cpu_us() - start);
  std::printf("plant and %u cameras: %.1f times real time\n", sim.description().camera_count,
              kSeconds / cost);
  const wb_sim_pose base = sim.truth().base_pose(sim.get());
  std::printf("base %.4f %.4f %.4f\n", base.p[0], base.p[1], base.p[2]);
  const double before = thread_cpu_us();
  const double clearance = sim.truth().clearance(sim.get(), nullptr);
  std::printf("clearance %.4f m in %.0f us\n", clearance, thread_cpu_us() - before);
  for (std::uint32_t i = 0; i < sim.truth().contact_count(sim.get()); ++i) {
    wb_sim_contact c{};
    sim.truth().contact(sim.get(), i, &c);
    std::printf("touch %s - %s (%s) at %.3f s\n", c.robot_geom, c.other_geom, c.object,
                to_seconds(c.t_ns));
  }
  picture(sim, argv[1], nullptr, 0);
  wb_sim_pose eye{};
  sim.truth().link_pose(sim.get(), "camera_shoulder", &eye);
  picture(sim, std::string(argv[1]) + ".shoulder.ppm", &eye, 1.51);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
