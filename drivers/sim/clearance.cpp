#include "drivers/sim/clearance.hpp"

#include <algorithm>
#include <limits>

namespace wb::sim {
namespace {

std::shared_ptr<fcl::CollisionGeometryd> shape(const mjModel& model, int geom) {
  const double* s = model.geom_size + 3 * geom;
  switch (model.geom_type[geom]) {
    case mjGEOM_BOX:
      return std::make_shared<fcl::Boxd>(2 * s[0], 2 * s[1], 2 * s[2]);
    case mjGEOM_CAPSULE:
      return std::make_shared<fcl::Capsuled>(s[0], 2 * s[1]);
    case mjGEOM_CYLINDER:
      return std::make_shared<fcl::Cylinderd>(s[0], 2 * s[1]);
    case mjGEOM_SPHERE:
      return std::make_shared<fcl::Sphered>(s[0]);
    case mjGEOM_ELLIPSOID:
      return std::make_shared<fcl::Ellipsoidd>(s[0], s[1], s[2]);
    default:
      return nullptr;  // the floor
  }
}

}  // namespace

Clearance::Clearance(const mjModel& model, const ContactLog& kinds) {
  for (int geom = 0; geom < model.ngeom; ++geom) {
    const std::shared_ptr<fcl::CollisionGeometryd> geometry = shape(model, geom);
    if (!geometry) continue;
    (kinds.is_robot(geom) ? robot_ : scene_)
        .push_back(
            {geom, model.geom_rbound[geom], std::make_unique<fcl::CollisionObjectd>(geometry)});
  }
  pairs_.reserve(robot_.size() * scene_.size());
}

void Clearance::update(std::vector<Body>& bodies, const mjData& data) {
  for (Body& body : bodies) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(data.geom_xmat +
                                                                           9 * body.geom);
    const Eigen::Map<const Eigen::Vector3d> p(data.geom_xpos + 3 * body.geom);
    body.object->setTransform(R, p);
  }
}

double Clearance::robot_to_scene(const mjData& data, const std::vector<bool>& skipped) {
  update(robot_, data);
  update(scene_, data);
  // Pairs in order of what their bounding spheres allow, until none can be nearer than the nearest.
  pairs_.clear();
  for (std::size_t i = 0; i < robot_.size(); ++i) {
    for (std::size_t j = 0; j < scene_.size(); ++j) {
      if (skipped[scene_[j].geom]) continue;
      const double between =
          (robot_[i].object->getTranslation() - scene_[j].object->getTranslation()).norm();
      pairs_.push_back({between - robot_[i].bounding_radius - scene_[j].bounding_radius, i, j});
    }
  }
  std::sort(pairs_.begin(), pairs_.end(),
            [](const Pair& a, const Pair& b) { return a.lower_bound < b.lower_bound; });
  double nearest = std::numeric_limits<double>::infinity();
  for (const Pair& pair : pairs_) {
    if (pair.lower_bound >= nearest) break;
    fcl::DistanceRequestd request;
    fcl::DistanceResultd result;
    fcl::distance(robot_[pair.robot].object.get(), scene_[pair.scene].object.get(), request,
                  result);
    nearest = std::min(nearest, std::max(result.min_distance, 0.0));
  }
  return nearest;
}

bool Clearance::column_is_free(const mjData& data, double x_m, double y_m, double radius_m) {
  constexpr double kHeight_m = 3.0;
  update(scene_, data);
  fcl::CollisionObjectd column(std::make_shared<fcl::Cylinderd>(radius_m, kHeight_m));
  column.setTranslation(Eigen::Vector3d(x_m, y_m, 0.5 * kHeight_m));
  return std::none_of(scene_.begin(), scene_.end(), [&](const Body& body) {
    fcl::CollisionRequestd request;
    fcl::CollisionResultd result;
    return fcl::collide(&column, body.object.get(), request, result) > 0;
  });
}

}  // namespace wb::sim
