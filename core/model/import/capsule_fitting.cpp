#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/model/import/shape_cloud.hpp"
#include "core/model/import/shape_fitting.hpp"

namespace wb {
namespace {

using Eigen::Vector3d;
using Points = std::vector<Vector3d>;
constexpr double kPi = std::numbers::pi;
// Room for rounding in what is written to robot.yaml with 4 decimals.
constexpr double kRounding_m = 2e-4;

double volume(const FittedCapsule& c) {
  return kPi * c.radius * c.radius * ((c.p1 - c.p0).norm() + 4.0 / 3 * c.radius);
}

// What a single fit minimises: volume times length, since a cylinder's least volume alone would
// have the capsule's round ends stand far out of the cylinder's flat ones.
double bulk(const FittedCapsule& c) { return volume(c) * ((c.p1 - c.p0).norm() + 2 * c.radius); }

Points surface_of(const FittedCapsule& c) {
  Points out;
  const Vector3d axis = c.p1 - c.p0;
  const int rings = 1 + static_cast<int>(axis.norm() / std::max(1e-3, 0.3 * c.radius));
  for (const Vector3d& d : unit_directions()) {
    out.push_back((d.dot(axis) < 0 ? c.p0 : c.p1) + c.radius * d);
  }
  if (axis.norm() < 1e-9) return out;
  const Vector3d u = axis.unitOrthogonal(), v = axis.normalized().cross(u);
  for (int i = 0; i <= rings; ++i) {
    for (int k = 0; k < 16; ++k) {
      const double a = kPi * k / 8;
      out.push_back(c.p0 + axis * i / rings + c.radius * (std::cos(a) * u + std::sin(a) * v));
    }
  }
  return out;
}

double overhang(const FittedCapsule& c, const ShapeCloud& cloud) {
  double worst = 0;
  for (const Vector3d& p : surface_of(c)) worst = std::max(worst, cloud.beyond(p));
  return worst;
}

// The capsule along a direction that holds the points and has the least bulk.
FittedCapsule fit_along(const Points& points, const Vector3d& axis) {
  const Vector3d u = axis.unitOrthogonal(), v = axis.cross(u);
  // Centre of the points across the axis: Badoiu and Clarkson 2003.
  Eigen::Vector2d centre(0, 0);
  const auto across = [&](const Vector3d& p) { return Eigen::Vector2d(u.dot(p), v.dot(p)); };
  for (const Vector3d& p : points) centre += across(p) / static_cast<double>(points.size());
  for (int i = 1; i <= 48; ++i) {
    Eigen::Vector2d furthest = centre;
    double most = -1;
    for (const Vector3d& p : points) {
      const Eigen::Vector2d q = across(p);
      if ((q - centre).squaredNorm() > most) {
        most = (q - centre).squaredNorm();
        furthest = q;
      }
    }
    centre += (furthest - centre) / (i + 1);
  }
  std::vector<Eigen::Vector2d> cylindrical;  // height, radius squared
  double widest = 0;
  for (const Vector3d& p : points) {
    const double rho2 = (across(p) - centre).squaredNorm();
    cylindrical.emplace_back(axis.dot(p), rho2);
    widest = std::max(widest, rho2);
  }
  widest = std::sqrt(widest);
  const Vector3d origin = centre.x() * u + centre.y() * v;
  FittedCapsule best;
  double least = 1e18;
  for (int i = 0; i <= 20; ++i) {
    const double r = std::max(1e-4, widest) * (1 + 0.04 * i);
    double low = 1e9, high = -1e9;
    for (const Eigen::Vector2d& p : cylindrical) {
      const double reach = std::sqrt(std::max(0.0, r * r - p.y()));
      low = std::min(low, p.x() + reach);
      high = std::max(high, p.x() - reach);
    }
    if (low > high) low = high = 0.5 * (low + high);
    const FittedCapsule c{origin + low * axis, origin + high * axis, r};
    if (bulk(c) < least) {
      least = bulk(c);
      best = c;
    }
  }
  return best;
}

// Corners that can touch a convex hull's supporting planes; the others decide nothing.
Points extremes(const Points& points) {
  if (points.size() < 200) return points;
  std::vector<std::size_t> chosen;
  for (const Vector3d& d : unit_directions()) {
    std::size_t best = 0;
    for (std::size_t i = 1; i < points.size(); ++i) {
      if (d.dot(points[i]) > d.dot(points[best])) best = i;
    }
    chosen.push_back(best);
  }
  std::sort(chosen.begin(), chosen.end());
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  Points out;
  for (const std::size_t i : chosen) out.push_back(points[i]);
  return out;
}

Eigen::Matrix3d principal_axes(const Points& points) {
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& p : points) mean += p / static_cast<double>(points.size());
  Eigen::Matrix3d C = Eigen::Matrix3d::Zero();
  for (const Vector3d& p : points) C += (p - mean) * (p - mean).transpose();
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(C).eigenvectors();
}

FittedCapsule fit_one(const Points& all) {
  const Points points = extremes(all);
  const Eigen::Matrix3d axes = principal_axes(points);
  FittedCapsule best;
  Vector3d axis = axes.col(2);
  double least = 1e18;
  const auto consider = [&](const Vector3d& direction) {
    const FittedCapsule c = fit_along(points, direction.normalized());
    if (bulk(c) >= (1 - 1e-6) * least) return;
    least = bulk(c);
    best = c;
    axis = direction.normalized();
  };
  for (int i = 0; i < 3; ++i) consider(axes.col(i));
  for (int i = 0; i < 3; ++i) consider(Vector3d::Unit(i));
  for (const double step : {0.2, 0.07, 0.02}) {
    const Vector3d u = axis.unitOrthogonal(), v = axis.cross(u), start = axis;
    for (const Vector3d& d : {u, Vector3d(-u), v, Vector3d(-v)}) consider(start + step * d);
  }
  for (const Vector3d& p : all) best.radius = std::max(best.radius, best.radius + best.distance(p));
  best.radius += kRounding_m;
  return best;
}

struct Part {
  Points corners;  // of whole triangles, three after three
  FittedCapsule capsule;
  double overhang_m = 0;
  bool whole = false;  // splitting it gains nothing

  Part(Points triangles, const ShapeCloud& cloud)
      : corners(std::move(triangles)),
        capsule(fit_one(corners)),
        overhang_m(overhang(capsule, cloud)) {}
};

std::vector<Part> split(const Part& part, const ShapeCloud& cloud) {
  const Eigen::Matrix3d axes = principal_axes(part.corners);
  std::vector<Part> best;
  double least = 0.9 * volume(part.capsule);
  for (int i = 0; i < 6; ++i) {
    const Vector3d axis = i < 3 ? Vector3d(axes.col(i)) : Vector3d(Vector3d::Unit(i - 3));
    double low = 1e9, high = -1e9;
    for (const Vector3d& p : part.corners) {
      low = std::min(low, axis.dot(p));
      high = std::max(high, axis.dot(p));
    }
    Points sides[2];
    for (std::size_t t = 0; t + 2 < part.corners.size(); t += 3) {
      const double middle =
          axis.dot(part.corners[t] + part.corners[t + 1] + part.corners[t + 2]) / 3;
      Points& side = sides[middle > 0.5 * (low + high)];
      side.insert(side.end(), part.corners.begin() + static_cast<std::ptrdiff_t>(t),
                  part.corners.begin() + static_cast<std::ptrdiff_t>(t) + 3);
    }
    if (sides[0].empty() || sides[1].empty()) continue;
    std::vector<Part> two{Part(sides[0], cloud), Part(sides[1], cloud)};
    const double sum = volume(two[0].capsule) + volume(two[1].capsule);
    if (sum >= least) continue;
    least = sum;
    best = std::move(two);
  }
  return best;
}

// Merges the two parts that lose least, if one capsule is nearly as good as their two or if it
// must.
bool merge_one(std::vector<Part>& parts, const ShapeCloud& cloud, bool must) {
  double least = 1e18;
  std::size_t first = 0, second = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (std::size_t j = i + 1; j < parts.size(); ++j) {
      Points both = extremes(parts[i].corners);
      const Points more = extremes(parts[j].corners);
      both.insert(both.end(), more.begin(), more.end());
      const double gain =
          volume(fit_one(both)) / (volume(parts[i].capsule) + volume(parts[j].capsule));
      if (gain < least) {
        least = gain;
        first = i;
        second = j;
      }
    }
  }
  if (!must && least > 1.1) return false;
  Points both = parts[first].corners;
  both.insert(both.end(), parts[second].corners.begin(), parts[second].corners.end());
  parts[first] = Part(both, cloud);
  parts.erase(parts.begin() + static_cast<std::ptrdiff_t>(second));
  return true;
}

}  // namespace

double FittedCapsule::distance(const Vector3d& p) const {
  const Vector3d d = p1 - p0;
  const double dd = d.squaredNorm();
  const double s = dd > 0 ? std::clamp((p - p0).dot(d) / dd, 0.0, 1.0) : 0.0;
  return (p - p0 - s * d).norm() - radius;
}

CapsuleFit fit_capsules(const std::vector<Solid>& body, int budget, double overhang_goal_m) {
  CapsuleFit fit;
  if (body.empty()) return fit;
  const ShapeCloud cloud(body);
  std::vector<Part> parts;
  for (const Solid& s : body) {
    const TriangleMesh hull = s.enclosing(2 * cloud.spacing);
    Points corners;
    for (const auto& [a, b, c] : hull.triangles)
      corners.insert(corners.end(), {hull.vertices[a], hull.vertices[b], hull.vertices[c]});
    parts.emplace_back(std::move(corners), cloud);
  }
  while (parts.size() > 1 && merge_one(parts, cloud, static_cast<int>(parts.size()) > budget)) {
  }
  while (static_cast<int>(parts.size()) < budget) {
    const auto worst =
        std::max_element(parts.begin(), parts.end(), [](const Part& a, const Part& b) {
          return (a.whole ? -1 : a.overhang_m) < (b.whole ? -1 : b.overhang_m);
        });
    if (worst->whole || worst->overhang_m <= overhang_goal_m) break;
    std::vector<Part> two = split(*worst, cloud);
    if (two.empty()) {
      worst->whole = true;
      continue;
    }
    *worst = two[0];
    parts.push_back(two[1]);
  }
  for (const Part& part : parts) {
    fit.capsules.push_back(part.capsule);
    fit.quality.overhang_m = std::max(fit.quality.overhang_m, part.overhang_m);
  }
  measure_coverage(
      body, 0.61 * cloud.spacing,
      [&](const Vector3d& p) {
        double nearest = 1e9;
        for (const FittedCapsule& c : fit.capsules) nearest = std::min(nearest, c.distance(p));
        return nearest;
      },
      fit.quality);
  return fit;
}

}  // namespace wb
