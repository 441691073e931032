#include "planning/base_route.hpp"

#include <algorithm>
#include <cmath>

namespace wb {
namespace {
double wrap(double a) { return std::remainder(a, 2 * M_PI); }
}  // namespace

BaseRoute::BaseRoute(const BaseConfig& base, const config::Section& section)
    : base_(base),
      radius_m_(base.bounding_radius_m + section.number("margin_m", config::kNonNegative)),
      comfort_m_(section.number("comfort_m", config::kPositive)),
      comfort_weight_(section.number("comfort_weight", config::kNonNegative)),
      low_m_(section.number("height_low_m")),
      high_m_(section.number("height_high_m")),
      lookahead_m_(section.number("lookahead_m", config::kPositive)),
      clearance_(kMaxCells),
      cost_(kMaxCells),
      next_(kMaxCells),
      heap_(kMaxCells),
      heap_place_(kMaxCells) {
  // An omnidirectional base has no need to back up.
  if (base_.kind == BaseKind::kDifferentialDrive)
    reverse_m_ = section.number("reverse_m", config::kNonNegative);
  const double speed_factor = section.number("speed_factor", config::kFraction);
  v_max_ = speed_factor * base_.velocity_max;
  w_max_ = speed_factor * base_.yaw_rate_max;
  a_max_ = 0.7 * base_.acceleration_max;
  b_max_ = 0.7 * base_.yaw_acceleration_max;
  section.finish();
}

void BaseRoute::flatten(const DistanceField& field) RT_SAFE {
  const auto& size = field.size();
  if (size[0] * size[1] > kMaxCells) return;
  nx_ = size[0];
  ny_ = size[1];
  resolution_ = field.resolution();
  origin_ = field.origin_W.head<2>();
  std::fill_n(clearance_.begin(), nx_ * ny_, static_cast<float>(DistanceField::kNoMap));
  for (int k = 0; k < size[2]; ++k) {
    const double z = field.origin_W.z() + (k + 0.5) * resolution_;
    if (z < low_m_ || z > high_m_) continue;
    const float* layer = field.data() + field.index(0, 0, k);
    for (int i = 0; i < nx_ * ny_; ++i) clearance_[i] = std::min(clearance_[i], layer[i]);
  }
  field_seq_ = field.seq;
  have_map_ = true;
}

double BaseRoute::clearance(const Eigen::Vector2d& p) const RT_SAFE {
  if (!have_map_) return DistanceField::kNoMap;
  const int i = std::clamp(static_cast<int>((p.x() - origin_.x()) / resolution_), 0, nx_ - 1);
  const int j = std::clamp(static_cast<int>((p.y() - origin_.y()) / resolution_), 0, ny_ - 1);
  return clearance_[j * nx_ + i];
}

bool BaseRoute::clear_line(const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                           double needed) const RT_SAFE {
  const int steps = std::max(1, static_cast<int>((b - a).norm() / (0.5 * resolution_)));
  for (int s = 0; s <= steps; ++s) {
    if (clearance(a + (b - a) * (static_cast<double>(s) / steps)) < needed) return false;
  }
  return true;
}

// Dijkstra from the goal outwards, so that next_[cell] leads there; stops when the start is
// settled. Cells nearer to obstacles than the robot's circle are not forbidden but dear: a robot
// that stands too close must find its way out.
void BaseRoute::search(const Eigen::Vector2d& from, const Eigen::Vector2d& to) RT_SAFE {
  waypoints_ = 0;
  waypoint_[waypoints_++] = from;
  const double direct = std::min({comfort_m_, clearance(from) - 1e-3, clearance(to) - 1e-3});
  if (!have_map_ || clear_line(from, to, std::max(radius_m_, direct))) {
    waypoint_[waypoints_++] = to;
    return;
  }
  const auto cell = [&](const Eigen::Vector2d& p) {
    const int i = std::clamp(static_cast<int>((p.x() - origin_.x()) / resolution_), 0, nx_ - 1);
    const int j = std::clamp(static_cast<int>((p.y() - origin_.y()) / resolution_), 0, ny_ - 1);
    return j * nx_ + i;
  };
  const auto price = [&](int c) {  // cost of a metre in this cell
    const double d = clearance_[c];
    if (d < radius_m_) return 50.0 + 200.0 * (radius_m_ - d);
    return 1.0 + comfort_weight_ * std::max(0.0, comfort_m_ - d);
  };
  constexpr float kFar = 1e30f;
  std::fill_n(cost_.begin(), nx_ * ny_, kFar);
  std::fill_n(next_.begin(), nx_ * ny_, -1);
  std::fill_n(heap_place_.begin(), nx_ * ny_, -1);
  int heap_size = 0;
  const auto place = [&](int slot, int c) {
    heap_[slot] = c;
    heap_place_[c] = slot;
  };
  const auto rise = [&](int slot) {
    const int c = heap_[slot];
    while (slot > 0 && cost_[heap_[(slot - 1) / 2]] > cost_[c]) {
      place(slot, heap_[(slot - 1) / 2]);
      slot = (slot - 1) / 2;
    }
    place(slot, c);
  };
  const int start = cell(from), goal = cell(to);
  cost_[goal] = 0;
  place(0, goal);
  heap_size = 1;
  while (heap_size > 0) {
    const int c = heap_[0];
    if (--heap_size > 0) {  // take the smallest: the last one sinks from the top
      const int moved = heap_[heap_size];
      int slot = 0;
      for (;;) {
        int child = 2 * slot + 1;
        if (child >= heap_size) break;
        if (child + 1 < heap_size && cost_[heap_[child + 1]] < cost_[heap_[child]]) ++child;
        if (cost_[heap_[child]] >= cost_[moved]) break;
        place(slot, heap_[child]);
        slot = child;
      }
      place(slot, moved);
    }
    heap_place_[c] = -2;  // settled
    if (c == start) break;
    const int i = c % nx_, j = c / nx_;
    for (int dj = -1; dj <= 1; ++dj) {
      for (int di = -1; di <= 1; ++di) {
        if ((!di && !dj) || i + di < 0 || i + di >= nx_ || j + dj < 0 || j + dj >= ny_) continue;
        const int n = c + dj * nx_ + di;
        if (heap_place_[n] == -2) continue;
        const double metres = resolution_ * (di && dj ? M_SQRT2 : 1.0);
        const float candidate = static_cast<float>(cost_[c] + metres * price(n));
        if (candidate >= cost_[n]) continue;
        cost_[n] = candidate;
        next_[n] = c;
        if (heap_place_[n] < 0) {
          place(heap_size, n);
          ++heap_size;
        }
        rise(heap_place_[n]);
      }
    }
  }

  // Pull the string: from each way point to the farthest cell in clear sight.
  const auto centre = [&](int c) {
    return Eigen::Vector2d(origin_.x() + (c % nx_ + 0.5) * resolution_,
                           origin_.y() + (c / nx_ + 0.5) * resolution_);
  };
  Eigen::Vector2d at = from;
  int c = start;
  while (c != goal && next_[c] >= 0 && waypoints_ < kMaxWaypoints - 1) {
    int farthest = next_[c];
    double least = std::min(clearance_[c], clearance_[farthest]);
    for (int n = farthest; n >= 0; n = next_[n]) {
      least = std::min<double>(least, clearance_[n]);
      // A short cut may not be tighter than the way it replaces, nor than the robot is wide.
      if (!clear_line(at, centre(n), std::max(radius_m_, std::min(least, comfort_m_)) - 1e-6))
        break;
      farthest = n;
      if (n == goal) break;
    }
    c = farthest;
    at = centre(c);
    if (c != goal) waypoint_[waypoints_++] = at;
  }
  waypoint_[waypoints_++] = to;
}

std::array<double, 3> BaseRoute::wish_of_unicycle(const std::array<double, 3>& pose,
                                                  const Eigen::Vector2d& target, double left,
                                                  bool arrived, double goal_yaw) const RT_SAFE {
  // A base that stopped a little off the goal turns on the spot; it does not set out again for the
  // rest.
  constexpr double kClose = 0.05, kArrived = 0.10;
  const Eigen::Vector2d p(pose[0], pose[1]);
  if (left > (arrived ? kArrived : kClose)) {
    double bearing = wrap(std::atan2(target.y() - p.y(), target.x() - p.x()) - pose[2]);
    double sign = 1.0;
    if (left < reverse_m_ &&
        std::abs(bearing) > M_PI / 2) {  // a short way back is driven backwards
      bearing = wrap(bearing - M_PI);
      sign = -1.0;
    }
    // Turn first, then drive: the slower, the more the heading is off.
    const double facing = std::max(0.0, std::cos(std::min(1.5 * std::abs(bearing), M_PI / 2)));
    const double v = std::min(v_max_ * facing, std::sqrt(2 * a_max_ * std::max(0.0, left - 0.02)));
    return {sign * v, 0.0, std::clamp(2.5 * bearing, -w_max_, w_max_)};
  }
  // What lies ahead or behind is made good during the turn; what lies aside stays.
  const Eigen::Vector2d goal = waypoint_[waypoints_ - 1];
  const double along = (goal - p).dot(Eigen::Vector2d(std::cos(pose[2]), std::sin(pose[2])));
  const double v = std::copysign(
      std::min(std::sqrt(2 * a_max_ * std::abs(along)), 4.0 * std::abs(along)), along);
  return {v, 0.0, wish_of_turn(wrap(goal_yaw - pose[2]))};
}

// Straight to the target, turning to the goal's yaw from the start: the robot's circle does not
// care which way it faces.
std::array<double, 3> BaseRoute::wish_of_omnidirectional(const std::array<double, 3>& pose,
                                                         const Eigen::Vector2d& target, double left,
                                                         double goal_yaw) const RT_SAFE {
  const Eigen::Vector2d way_W = target - Eigen::Vector2d(pose[0], pose[1]);
  // The square root of braking is too steep to follow near the goal.
  const double v = std::min({v_max_, std::sqrt(2 * a_max_ * left), 4.0 * left});
  const Eigen::Vector2d v_B =
      Eigen::Rotation2Dd(-pose[2]) * (way_W * (v / std::max(way_W.norm(), 1e-9)));
  return {v_B.x(), v_B.y(), wish_of_turn(wrap(goal_yaw - pose[2]))};
}

double BaseRoute::wish_of_turn(double turn) const RT_SAFE {
  if (std::abs(turn) < 0.01) return turn;
  return std::copysign(std::min(w_max_, std::sqrt(2 * b_max_ * std::abs(turn))), turn);
}

void BaseRoute::follow(TimeNs t0, std::array<double, 3> pose, std::array<double, 3> velocity,
                       Reference& ref) const RT_SAFE {
  constexpr double kStep = 0.02;        // s, simulation
  constexpr int kStepsPerKeyframe = 5;  // 0.1 s
  const Eigen::Vector2d goal = waypoint_[waypoints_ - 1];
  constexpr double kArrived = 0.10;
  const bool arrived = (goal - Eigen::Vector2d(pose[0], pose[1])).norm() < kArrived;
  int segment = 0;
  ref.base_count = 0;
  for (int step = 0; ref.base_count < kMaxKeyframes - 16; ++step) {
    if (step % kStepsPerKeyframe == 0) {
      BaseKeyframe& k = ref.base[ref.base_count++];
      k.t_ns = t0 + from_seconds(step * kStep);
      k.base = pose;
    }
    const Eigen::Vector2d p(pose[0], pose[1]);
    // Progress along the polyline, then the point one look-ahead further.
    while (segment < waypoints_ - 2) {
      const Eigen::Vector2d d = waypoint_[segment + 1] - waypoint_[segment];
      if ((p - waypoint_[segment]).dot(d) < d.squaredNorm()) break;
      ++segment;
    }
    const Eigen::Vector2d d = waypoint_[segment + 1] - waypoint_[segment];
    const double length = std::max(d.norm(), 1e-9);
    const double along = std::clamp((p - waypoint_[segment]).dot(d) / length, 0.0, length);
    Eigen::Vector2d target = waypoint_[segment] + d / length * along;
    double ahead = lookahead_m_, left = 0;
    for (int s = segment; s < waypoints_ - 1; ++s) {
      const double rest = (waypoint_[s + 1] - target).norm();
      if (rest >= ahead || s == waypoints_ - 2) {
        target += (waypoint_[s + 1] - target) * (rest > 1e-9 ? std::min(1.0, ahead / rest) : 1.0);
        break;
      }
      ahead -= rest;
      target = waypoint_[s + 1];
    }
    left = (goal - p).norm();

    std::array<double, 3> wish =
        base_.kind == BaseKind::kOmnidirectional
            ? wish_of_omnidirectional(pose, target, left, ref.base_goal[2])
            : wish_of_unicycle(pose, target, left, arrived, ref.base_goal[2]);
    // No faster than the reference allows.
    const double slow =
        std::min(1.0, ref.speed_scale * v_max_ / std::max(std::hypot(wish[0], wish[1]), 1e-9));
    wish = {slow * wish[0], slow * wish[1],
            std::clamp(wish[2], -ref.speed_scale * w_max_, ref.speed_scale * w_max_)};
    for (int i = 0; i < 3; ++i) {
      const double change = (i == 2 ? b_max_ : a_max_) * kStep;
      velocity[i] += std::clamp(wish[i] - velocity[i], -change, change);
    }
    const double heading = pose[2] + 0.5 * velocity[2] * kStep;
    const double cosine = std::cos(heading), sine = std::sin(heading);
    pose[0] += (velocity[0] * cosine - velocity[1] * sine) * kStep;
    pose[1] += (velocity[0] * sine + velocity[1] * cosine) * kStep;
    pose[2] += velocity[2] * kStep;
  }
}

void BaseRoute::plan(TimeNs t0, const std::array<double, 3>& start,
                     const std::array<double, 3>& velocity, const DistanceField* field,
                     Reference& reference) RT_SAFE {
  if (field && !field->empty() && (field->seq != field_seq_ || !have_map_)) flatten(*field);
  search({start[0], start[1]}, {reference.base_goal[0], reference.base_goal[1]});
  follow(t0, start, velocity, reference);
}

}  // namespace wb
