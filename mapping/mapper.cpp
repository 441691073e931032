#include "mapping/mapper.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/config/config.hpp"
#include "mapping/distance_transform.hpp"
#include "mapping/pose_history.hpp"
#include "mapping/robot_filter.hpp"
#include "mapping/voxel_map.hpp"

namespace wb {
namespace {

struct MapperConfig {
  VoxelMapConfig map;
  int truncation = 0;  // voxels
  double robot_padding_m = 0;
  double no_return_carve_m = 0;

  static MapperConfig load(const RobotConfig& robot) {
    using config::Range;
    const config::Section file = config::Section::open(robot.folder / "mapping.yaml");
    MapperConfig c;
    const std::vector<double> size = file.numbers("size_voxels", 3, Range{4, 512});
    for (int a = 0; a < 3; ++a) {
      if (size[a] != std::floor(size[a])) file.fail("size_voxels", "must hold whole numbers");
      c.map.size[a] = static_cast<int>(size[a]);
    }
    c.map.resolution_m = file.number("resolution_m", Range{0.01, 1.0});
    c.map.bottom_m = file.number("bottom_m", Range{-10.0, 0.0});
    c.map.recentre_m = file.number("recentre_m", config::kNonNegative);
    c.map.floor_height_m = file.number("floor_height_m", Range{0.0, 0.5});
    c.map.solid_behind_m = file.number("solid_behind_m", Range{0.0, 1.0});
    // Stored as 16-bit thousandths.
    c.map.log_odds_hit = file.number("log_odds_hit", Range{0.01, 10.0});
    c.map.log_odds_miss = file.number("log_odds_miss", Range{0.01, 10.0});
    c.map.log_odds_min = file.number("log_odds_min", Range{-10.0, -0.01});
    c.map.log_odds_max = file.number("log_odds_max", Range{0.01, 10.0});
    c.map.log_odds_occupied =
        file.number("log_odds_occupied", Range{0.01, c.map.log_odds_max - 0.01});
    for (const CameraConfig& camera : robot.cameras) {
      c.map.rays_per_scan =
          std::max(c.map.rays_per_scan, camera.intrinsics.width * camera.intrinsics.height);
    }
    const double truncation_m = file.number(
        "truncation_m",
        Range{c.map.resolution_m, DistanceTransform::kMaxTruncation * c.map.resolution_m});
    c.truncation = static_cast<int>(std::lround(truncation_m / c.map.resolution_m));
    c.robot_padding_m = file.number("robot_padding_m", Range{0.0, 0.5});
    c.no_return_carve_m = file.number("no_return_carve_m", Range{0.0, 100.0});
    file.finish();
    const double half_m = 0.5 * std::min(c.map.size[0], c.map.size[1]) * c.map.resolution_m;
    if (half_m < c.map.recentre_m + c.map.resolution_m + robot.base.bounding_radius_m) {
      file.fail("recentre_m", "lets the robot leave the window");
    }
    return c;
  }
};

}  // namespace

struct Mapper::Impl {
  Impl(std::shared_ptr<const RobotModel> robot, const MapperConfig& c)
      : config(c),
        model(std::move(robot)),
        history(model->base_dof(), model->joints()),
        map(c.map),
        filter(*model, c.robot_padding_m),
        transform(c.map.size, c.truncation),
        on_robot(c.map.rays_per_scan),
        solid(map.size()) {
    for (const CameraConfig& camera : model->config().cameras) {
      camera_frames.push_back(model->frame(camera.name));
    }
  }

  // The frame is of a camera of the robot, its pixels fit the storage, and its rays are finite.
  bool fits(const DepthFrame& frame) const {
    const CameraIntrinsics& k = frame.intrinsics;
    const bool size = k.width > 0 && k.height > 0 &&
                      k.width <= config.map.rays_per_scan / k.height &&
                      frame.depth.size() == static_cast<std::size_t>(k.width) * k.height;
    const bool rays = k.fx >= 1 && k.fy >= 1 && std::abs(k.cx) < 1e5 && std::abs(k.cy) < 1e5 &&
                      k.range_min_m > 0 && k.range_max_m < 1e3;
    return frame.camera >= 0 && frame.camera < static_cast<int>(camera_frames.size()) && size &&
           rays;
  }

  bool integrate(const DepthFrame& frame, MapReport& report) RT_SAFE {
    PoseHistory::State x;
    if (!fits(frame) || !history.at(frame.t_ns, x)) return false;
    model->forward_kinematics(x.data(), data);
    const Eigen::Isometry3d X_WC = model->X_WF(camera_frames[frame.camera], data);
    report.pixels_on_robot += filter.mark(frame, X_WC, data, on_robot.data());

    const CameraIntrinsics& k = frame.intrinsics;
    const auto nearest = static_cast<float>(k.range_min_m),
               furthest = static_cast<float>(k.range_max_m);
    const auto carve = static_cast<float>(config.no_return_carve_m);
    map.begin_scan(X_WC);
    for (int v = 0, i = 0; v < k.height; ++v) {
      const auto y_slope = static_cast<float>((v + 0.5 - k.cy) / k.fy);
      for (int u = 0; u < k.width; ++u, ++i) {
        const auto x_slope = static_cast<float>((u + 0.5 - k.cx) / k.fx);
        const float z = frame.depth[i];
        if (z >= nearest && z <= furthest) {
          map.add({x_slope * z, y_slope * z, z}, on_robot[i] ? RayEnd::kBlocked : RayEnd::kSurface);
        } else if (carve > 0 && z == std::numeric_limits<float>::infinity()) {
          map.add({x_slope * carve, y_slope * carve, carve}, RayEnd::kOpen);
        }
      }
    }
    map.end_scan();
    newest_frame_ns = std::max(newest_frame_ns, frame.t_ns);
    return true;
  }

  MapperConfig config;
  std::shared_ptr<const RobotModel> model;
  PoseHistory history;
  VoxelMap map;
  RobotFilter filter;
  DistanceTransform transform;
  std::vector<int> camera_frames;  // by camera: the model's frame
  std::vector<std::uint8_t> on_robot;
  std::vector<std::uint8_t> solid;
  RobotModel::Data data;
  TimeNs newest_frame_ns = 0;
};

Mapper::Mapper(std::shared_ptr<const RobotModel> model) {
  const MapperConfig config = MapperConfig::load(model->config());
  impl_ = std::make_unique<Impl>(std::move(model), config);
}

Mapper::~Mapper() = default;

void Mapper::push_state(const RobotState& state) RT_SAFE { impl_->history.push(state); }

MapReport Mapper::update(std::span<const DepthFrame* const> frames, DistanceField& field) RT_SAFE {
  Impl& m = *impl_;
  MapReport report;
  const auto [x, y] = m.history.newest_base();
  if (!m.history.empty()) m.map.follow({x, y});
  for (const DepthFrame* frame : frames) {
    ++(m.integrate(*frame, report) ? report.frames : report.frames_without_pose);
  }
  report.occupied = m.map.solid(m.solid.data());
  m.transform.signed_distance(m.solid.data(), field);
  field.origin_W = m.map.origin_W();
  field.t_ns = m.newest_frame_ns;
  return report;
}

DistanceField Mapper::make_field() const {
  return DistanceField(impl_->config.map.size, impl_->config.map.resolution_m);
}

void Mapper::reset() RT_SAFE {
  impl_->map.clear();
  impl_->newest_frame_ns = 0;
}

float Mapper::log_odds(const Eigen::Vector3d& p_W) const RT_SAFE {
  return impl_->map.log_odds(p_W);
}

}  // namespace wb
