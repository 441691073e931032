#include <algorithm>

#include "core/config/config.hpp"
#include "core/model/import/shape_cloud.hpp"
#include "core/model/import/shape_fitting.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;
// Room for rounding in what is written to robot.yaml with 4 decimals.
constexpr double kRounding_m = 2e-4;

// Centres spread over the volume: furthest points first, then Lloyd's iterations.
Points centres_of(const Points& volume, int count) {
  Points centres;
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& p : volume) mean += p / static_cast<double>(volume.size());
  if (count == 1) return {mean};
  std::vector<double> nearest(volume.size());
  for (std::size_t i = 0; i < volume.size(); ++i) nearest[i] = (volume[i] - mean).squaredNorm();
  while (static_cast<int>(centres.size()) < count) {
    const auto furthest = std::max_element(nearest.begin(), nearest.end()) - nearest.begin();
    centres.push_back(volume[static_cast<std::size_t>(furthest)]);
    for (std::size_t i = 0; i < volume.size(); ++i) {
      const double d = (volume[i] - centres.back()).squaredNorm();
      nearest[i] = centres.size() == 1 ? d : std::min(nearest[i], d);
    }
  }
  for (int iteration = 0; iteration < 25; ++iteration) {
    Points sums(centres.size(), Vector3d::Zero());
    std::vector<int> counts(centres.size());
    for (const Vector3d& p : volume) {
      std::size_t best = 0;
      for (std::size_t c = 1; c < centres.size(); ++c) {
        if ((p - centres[c]).squaredNorm() < (p - centres[best]).squaredNorm()) best = c;
      }
      sums[best] += p;
      ++counts[best];
    }
    for (std::size_t c = 0; c < centres.size(); ++c) {
      if (counts[c] > 0) centres[c] = sums[c] / counts[c];
    }
  }
  return centres;
}

SphereFit fit_spheres(const ShapeCloud& cloud, const std::vector<Solid>& body, int count) {
  SphereFit fit;
  const Points centres = centres_of(cloud.inside.size() > 40 ? cloud.inside : cloud.surface, count);
  for (const Vector3d& c : centres) fit.spheres.push_back({c, 0});
  for (const Solid& s : body) {
    for (const Vector3d& p : s.surface(0.4 * cloud.spacing)) {
      const auto best =
          std::min_element(fit.spheres.begin(), fit.spheres.end(), [&](auto& a, auto& b) {
            return (p - a.centre).squaredNorm() < (p - b.centre).squaredNorm();
          });
      best->radius = std::max(best->radius, (p - best->centre).norm() + kRounding_m);
    }
  }
  std::erase_if(fit.spheres, [](const FittedSphere& s) { return s.radius == 0; });
  for (const FittedSphere& s : fit.spheres) {
    for (const Vector3d& d : unit_directions()) {
      fit.quality.overhang_m =
          std::max(fit.quality.overhang_m, cloud.beyond(s.centre + s.radius * d));
    }
  }
  measure_coverage(
      body, 0.61 * cloud.spacing,
      [&](const Vector3d& p) {
        double nearest = 1e9;
        for (const FittedSphere& s : fit.spheres)
          nearest = std::min(nearest, (p - s.centre).norm() - s.radius);
        return nearest;
      },
      fit.quality);
  return fit;
}

}  // namespace

std::vector<SphereFit> fit_spheres(const std::vector<std::vector<Solid>>& bodies, int budget,
                                   double overhang_goal_m) {
  std::vector<SphereFit> fits(bodies.size());
  std::vector<ShapeCloud> clouds;
  int used = 0;
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    if (bodies[i].empty()) {
      clouds.push_back(clouds.empty() ? ShapeCloud({Solid{}}) : clouds.back());  // never asked
      continue;
    }
    clouds.emplace_back(bodies[i]);
    fits[i] = fit_spheres(clouds[i], bodies[i], 1);
    ++used;
  }
  if (used > budget) {
    throw config::ConfigError("there are " + std::to_string(used) +
                              " moving bodies with shapes for " + std::to_string(budget) +
                              " collision spheres");
  }
  std::vector<bool> done(bodies.size());
  while (used < budget) {
    std::size_t worst = bodies.size();
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      if (done[i] || fits[i].quality.overhang_m <= overhang_goal_m) continue;
      if (worst == bodies.size() || fits[i].quality.overhang_m > fits[worst].quality.overhang_m)
        worst = i;
    }
    if (worst == bodies.size()) break;
    // One more may not help where several do: a square needs four.
    const int have = static_cast<int>(fits[worst].spheres.size());
    SphereFit best = fits[worst];
    for (int more = 1; more <= 10 && used + more <= budget; ++more) {
      const SphereFit next = fit_spheres(clouds[worst], bodies[worst], have + more);
      if (next.quality.overhang_m < best.quality.overhang_m - 1e-3) {
        best = next;
        break;
      }
    }
    done[worst] = best.spheres.size() == fits[worst].spheres.size();
    used += static_cast<int>(best.spheres.size()) - have;
    fits[worst] = best;
  }
  return fits;
}

}  // namespace wb
