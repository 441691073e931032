// Capsules (self-collision) and spheres (environment) that cover a body's collision shapes. Setup
// world; deterministic. SI units, everything in the body's frame. Capsules: greedy merging and
// splitting of the shapes' triangles; each covers its triangles exactly, since it is convex and
// holds their corners. Spheres: centroids of the volume (Lloyd), grown until the surface is inside.
#pragma once
#include <Eigen/Core>
#include <vector>

#include "core/model/import/solid.hpp"

namespace wb {

struct FittedCapsule {
  Eigen::Vector3d p0, p1;
  double radius = 0;
  double distance(const Eigen::Vector3d& p) const;
};

struct FittedSphere {
  Eigen::Vector3d centre;
  double radius = 0;
};

// How good a fit is, by samples of the shapes' surface and of the fitted bodies'.
struct FitQuality {
  double coverage = 1;      // share of the surface samples inside the fitted set
  double sticks_out_m = 0;  // furthest that a sample lies outside of it
  double overhang_m = 0;    // furthest that the fitted set reaches beyond the shapes
};

struct CapsuleFit {
  std::vector<FittedCapsule> capsules;
  FitQuality quality;
};

struct SphereFit {
  std::vector<FittedSphere> spheres;
  FitQuality quality;
};

// At most `budget` capsules; fewer where none reaches more than `overhang_goal_m` beyond the
// shapes.
CapsuleFit fit_capsules(const std::vector<Solid>& body, int budget, double overhang_goal_m);

// At most `budget` spheres for all bodies together, at least one for each body with a shape: the
// next one goes to the body whose overhang is largest, until all are below the goal.
std::vector<SphereFit> fit_spheres(const std::vector<std::vector<Solid>>& bodies, int budget,
                                   double overhang_goal_m);

}  // namespace wb
