// Route of a driving base to a goal pose: shortest clear path on a horizontal slice of the distance
// field, smoothed, then followed within the base's limits by a simulated unicycle, or by an
// omnidirectional base that turns on the way: timed keyframes that the MPC can track. MPC loop,
// step world: fixed storage, bounded work, no allocation. Frame W, SI. Source: Dijkstra 1959;
// Coulter 1992 (pure pursuit). Why the MPC needs it: docs/decisions/0001-base-route.md.
#pragma once
#include <array>
#include <vector>

#include "core/config/config.hpp"
#include "core/model/robot_config.hpp"
#include "core/rt/rt_safe.hpp"
#include "core/types/distance_field.hpp"
#include "core/types/reference.hpp"

namespace wb {

class BaseRoute {
 public:
  BaseRoute(const BaseConfig& base, const config::Section& section);

  // Fills reference.base with the route from `start` (x, y, yaw; velocities in B) to
  // reference.base_goal, beginning at t0. Without a map, or where no clear path is known, the route
  // leads straight.
  void plan(TimeNs t0, const std::array<double, 3>& start, const std::array<double, 3>& velocity,
            const DistanceField* field, Reference& reference) RT_SAFE;

  // Way points of the last plan, for views and tests.
  int waypoint_count() const { return waypoints_; }
  Eigen::Vector2d waypoint(int i) const { return waypoint_[i]; }

 private:
  static constexpr int kMaxCells = 128 * 128;
  static constexpr int kMaxWaypoints = 256;

  void flatten(
      const DistanceField& field) RT_SAFE;  // clearance of each column, once for each field
  double clearance(const Eigen::Vector2d& p) const RT_SAFE;
  bool clear_line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, double needed) const RT_SAFE;
  void search(const Eigen::Vector2d& from, const Eigen::Vector2d& to) RT_SAFE;
  void follow(TimeNs t0, std::array<double, 3> pose, std::array<double, 3> velocity,
              Reference& reference) const RT_SAFE;
  // What the base wants to do next: velocities in B.
  std::array<double, 3> wish_of_unicycle(const std::array<double, 3>& pose,
                                         const Eigen::Vector2d& target, double left, bool arrived,
                                         double goal_yaw) const RT_SAFE;
  std::array<double, 3> wish_of_omnidirectional(const std::array<double, 3>& pose,
                                                const Eigen::Vector2d& target, double left,
                                                double goal_yaw) const RT_SAFE;

  double wish_of_turn(double turn) const RT_SAFE;

  BaseConfig base_;
  double v_max_, w_max_, a_max_, b_max_;  // of what the base can do, the MPC needs some
  double radius_m_, comfort_m_, comfort_weight_, low_m_, high_m_, lookahead_m_, reverse_m_ = 0;

  // Slice of the map: nx * ny cells.
  std::uint64_t field_seq_ = 0;
  bool have_map_ = false;
  int nx_ = 0, ny_ = 0;
  double resolution_ = 0.1;
  Eigen::Vector2d origin_{0, 0};
  std::vector<float> clearance_, cost_;
  std::vector<int> next_, heap_, heap_place_;

  int waypoints_ = 0;
  std::array<Eigen::Vector2d, kMaxWaypoints> waypoint_;
};

}  // namespace wb
