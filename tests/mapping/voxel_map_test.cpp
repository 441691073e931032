// VoxelMap: rolling window, traversal, evidence, unknown space.
#include "mapping/voxel_map.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

namespace wb {
namespace {

constexpr double kResolution = 0.1;
constexpr float kHit = 0.85f, kMiss = 0.3f, kMin = -0.6f, kMax = 2.0f, kOccupied = 1.0f;
constexpr float kUnit = 1e-3f;  // log-odds are stored in thousandths

VoxelMapConfig small_config() {
  VoxelMapConfig c;
  c.size = {20, 16, 12};
  c.resolution_m = kResolution;
  c.bottom_m = -0.2;
  c.recentre_m = 0.3;
  c.floor_height_m = -1;  // no floor
  c.solid_behind_m = 0;
  c.log_odds_hit = kHit;
  c.log_odds_miss = kMiss;
  c.log_odds_min = kMin;
  c.log_odds_max = kMax;
  c.log_odds_occupied = kOccupied;
  c.rays_per_scan = 1000;
  return c;
}

// A camera at p_W whose axes are W's.
Eigen::Isometry3d camera_at(const Eigen::Vector3d& p_W) {
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.translation() = p_W;
  return X;
}

void scan(VoxelMap& map, const Eigen::Vector3d& from,
          std::vector<std::pair<Eigen::Vector3d, RayEnd>> rays) {
  map.begin_scan(camera_at(from));
  for (const auto& [to, kind] : rays) map.add((to - from).cast<float>(), kind);
  map.end_scan();
}

using Voxel = std::array<int, 3>;

Eigen::Vector3d centre(const Voxel& v) {
  return kResolution * Eigen::Vector3d(v[0] + 0.5, v[1] + 0.5, v[2] + 0.5);
}

TEST(VoxelMap, RollingWindowEqualsAnInfiniteArray) {
  const VoxelMapConfig config = small_config();
  VoxelMap map(config);
  std::map<Voxel, float> reference;  // by voxel of W; absent: unknown
  std::mt19937 random(3);
  std::normal_distribution<double> stride(0.0, 0.35);
  Eigen::Vector2d base(0, 0);
  Voxel corner{-10, -8, -2};
  int moves = 0;
  for (int n = 0; n < 400; ++n) {
    base += Eigen::Vector2d(stride(random), stride(random));
    map.follow(base);
    for (int a = 0; a < 2; ++a) {
      const int voxel = static_cast<int>(std::floor(base[a] / kResolution));
      if (std::abs(voxel - (corner[a] + config.size[a] / 2)) > 3) {
        corner[a] = voxel - config.size[a] / 2;
        ++moves;
      }
    }
    std::erase_if(reference, [&](const auto& entry) {
      for (int a = 0; a < 3; ++a) {
        if (entry.first[a] < corner[a] || entry.first[a] >= corner[a] + config.size[a]) return true;
      }
      return false;
    });
    // A ray that starts and ends in one voxel hits or clears that voxel and no other.
    for (int s = 0; s < 30; ++s) {
      Voxel v;
      for (int a = 0; a < 3; ++a) {
        v[a] = corner[a] + std::uniform_int_distribution<int>(0, config.size[a] - 1)(random);
      }
      const bool hit = std::bernoulli_distribution(0.6)(random);
      const Eigen::Vector3d p = centre(v);
      scan(map, p,
           {{p + Eigen::Vector3d(0.01, 0.01, 0.01), hit ? RayEnd::kSurface : RayEnd::kOpen}});
      float& value = reference[v];
      value = hit ? std::min(value + kHit, kMax) : std::max(value - kMiss, kMin);
    }
    for (int k = 0; k < config.size[2]; ++k) {
      for (int j = 0; j < config.size[1]; ++j) {
        for (int i = 0; i < config.size[0]; ++i) {
          const Voxel v{corner[0] + i, corner[1] + j, corner[2] + k};
          const auto known = reference.find(v);
          // Two thousandths where the value came by the two that have a meaning of their own.
          ASSERT_NEAR(map.log_odds(centre(v)), known == reference.end() ? 0.0f : known->second,
                      2.5f * kUnit);
          if (known != reference.end()) {
            ASSERT_NE(map.log_odds(centre(v)), 0.0f) << "seen, but unknown";
          }
        }
      }
    }
  }
  EXPECT_GT(moves, 100);
}

TEST(VoxelMap, SolidMaskIsTheWindowInOrder) {
  VoxelMap map(small_config());
  map.follow({1.33, -2.71});
  const Eigen::Vector3d origin = map.origin_W();
  std::vector<std::uint8_t> mask(map.size());
  std::mt19937 random(5);
  for (int n = 0; n < 200; ++n) {
    const Voxel v{std::uniform_int_distribution<int>(0, 19)(random),
                  std::uniform_int_distribution<int>(0, 15)(random),
                  std::uniform_int_distribution<int>(0, 11)(random)};
    const Eigen::Vector3d p = origin + centre(v);
    for (int hit = 0; hit < 2; ++hit)
      scan(map, p, {{p + Eigen::Vector3d(0.01, 0, 0), RayEnd::kSurface}});
  }
  const int occupied = map.solid(mask.data());
  int count = 0;
  for (int k = 0; k < 12; ++k) {
    for (int j = 0; j < 16; ++j) {
      for (int i = 0; i < 20; ++i) {
        const bool expected = map.log_odds(origin + centre({i, j, k})) > kOccupied;
        ASSERT_EQ(mask[(k * 16 + j) * 20 + i], expected);
        count += expected;
      }
    }
  }
  EXPECT_EQ(occupied, count);
}

// Length of the segment within the voxel grown by `margin`, as a fraction of the segment; negative:
// they do not meet.
double overlap(const Eigen::Vector3d& from, const Eigen::Vector3d& to, const Eigen::Vector3d& low,
               double margin) {
  double enter = 0, leave = 1;
  for (int a = 0; a < 3; ++a) {
    const double d = to[a] - from[a];
    double t0 = (low[a] - margin - from[a]) / d, t1 = (low[a] + kResolution + margin - from[a]) / d;
    if (t0 > t1) std::swap(t0, t1);
    enter = std::max(enter, t0);
    leave = std::min(leave, t1);
  }
  return leave - enter;
}

TEST(VoxelMap, RayClearsExactlyTheVoxelsItCrosses) {
  const VoxelMapConfig config = small_config();
  VoxelMap map(config);
  const Eigen::Vector3d origin = map.origin_W();
  const Eigen::Vector3d extent(2.0, 1.6, 1.2);
  // Ends are rounded to the middle of 1/64 voxel; single precision before that is below 1e-5 voxel.
  constexpr double kMargin = kResolution / 128 + 1e-6;
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(0.001, 0.999);
  std::uniform_real_distribution<double> wide(-1.0, 2.0);
  int outside = 0;
  for (int n = 0; n < 1500; ++n) {
    Eigen::Vector3d from, to;
    for (int a = 0; a < 3; ++a) {
      from[a] = origin[a] + extent[a] * unit(random);
      to[a] = origin[a] + extent[a] * (n % 3 ? unit(random) : wide(random));
    }
    outside += ((to - origin).array() < 0).any() || ((to - origin).array() > extent.array()).any();
    map.clear();
    scan(map, from, {{to, RayEnd::kOpen}});
    for (int k = 0; k < config.size[2]; ++k) {
      for (int j = 0; j < config.size[1]; ++j) {
        for (int i = 0; i < config.size[0]; ++i) {
          const Eigen::Vector3d low = origin + kResolution * Eigen::Vector3d(i, j, k);
          const bool cleared = map.log_odds(low + Eigen::Vector3d::Constant(0.05)) < 0;
          if (cleared) {
            ASSERT_GE(overlap(from, to, low, kMargin), 0) << n;
          } else {
            ASSERT_LE(overlap(from, to, low, -kMargin), 0) << n;
          }
        }
      }
    }
  }
  EXPECT_GT(outside, 200);
}

TEST(VoxelMap, AxisParallelRaysEndWhereTheyShould) {
  VoxelMap map(small_config());
  const Eigen::Vector3d from(0.05, 0.05, 0.05);
  for (int a = 0; a < 3; ++a) {
    for (const double direction : {1.0, -1.0}) {
      map.clear();
      const double reach = direction > 0 ? 0.5 : 0.2;
      scan(map, from, {{from + direction * reach * Eigen::Vector3d::Unit(a), RayEnd::kSurface}});
      for (double d = 0; d < reach - 0.05; d += 0.1) {
        EXPECT_LT(map.log_odds(from + direction * d * Eigen::Vector3d::Unit(a)), 0);
      }
      EXPECT_GT(map.log_odds(from + direction * reach * Eigen::Vector3d::Unit(a)), 0);
    }
  }
}

TEST(VoxelMap, HitBeatsEveryMissOfItsScan) {
  VoxelMap map(small_config());
  const Eigen::Vector3d from(-0.75, 0.05, 0.05), leg(0.05, 0.05, 0.05);
  // A thin leg: one ray of nine ends on it, whichever comes first; the others pass through its
  // voxel.
  std::vector<std::pair<Eigen::Vector3d, RayEnd>> rays;
  for (int n = -4; n <= 4; ++n) rays.push_back({{0.85, 0.05 + 0.02 * n, 0.05}, RayEnd::kSurface});
  rays.insert(rays.begin() + 3, {leg, RayEnd::kSurface});
  scan(map, from, rays);
  EXPECT_FLOAT_EQ(map.log_odds(leg), kHit);
  scan(map, from, rays);
  EXPECT_GT(map.log_odds(leg), kOccupied);
}

TEST(VoxelMap, EvidenceCountsAgainOnceTheScanCountHasGoneRound) {
  const Eigen::Vector3d from(-0.75, 0.05, 0.05), object(0.05, 0.05, 0.05);
  for (const int scans_between : {65534, 65535, 65536}) {  // the count has 16 bits
    VoxelMap map(small_config());
    scan(map, from, {{object, RayEnd::kSurface}});
    for (int n = 0; n < scans_between; ++n) scan(map, from, {});
    scan(map, from, {{object, RayEnd::kSurface}});
    EXPECT_FLOAT_EQ(map.log_odds(object), 2 * kHit);
  }
}

TEST(VoxelMap, TwoHitsAppearAndFourMissesClear) {
  VoxelMap map(small_config());
  const Eigen::Vector3d from(-0.75, 0.05, 0.05), object(0.05, 0.05, 0.05),
      background(0.85, 0.05, 0.05);
  for (int n = 0; n < 20; ++n)
    scan(map, from, {{background, RayEnd::kSurface}});  // seen free for long
  scan(map, from, {{object, RayEnd::kSurface}});
  EXPECT_LT(map.log_odds(object), kOccupied);
  scan(map, from, {{object, RayEnd::kSurface}});
  EXPECT_GT(map.log_odds(object), kOccupied);
  for (int n = 0; n < 20; ++n) scan(map, from, {{object, RayEnd::kSurface}});  // there for long
  for (int n = 0; n < 3; ++n) scan(map, from, {{background, RayEnd::kSurface}});
  EXPECT_GT(map.log_odds(object), kOccupied);
  scan(map, from, {{background, RayEnd::kSurface}});
  EXPECT_LT(map.log_odds(object), kOccupied);
}

TEST(VoxelMap, FloorClearsAndNeverOccupies) {
  VoxelMapConfig config = small_config();
  config.floor_height_m = 0.05;
  VoxelMap map(config);
  const Eigen::Vector3d from(-0.75, 0.05, 0.45);
  for (int n = 0; n < 10; ++n) {
    scan(map, from,
         {{{0.65, 0.05, 0.02}, RayEnd::kSurface}, {{0.65, 0.25, 0.08}, RayEnd::kSurface}});
  }
  EXPECT_LT(map.log_odds({0.65, 0.05, 0.02}), 0);          // floor
  EXPECT_GT(map.log_odds({0.65, 0.25, 0.08}), kOccupied);  // a low thing in the same layer
}

TEST(VoxelMap, BlockedRayClearsBeforeItsEndOnly) {
  VoxelMap map(small_config());
  const Eigen::Vector3d from(-0.75, 0.05, 0.05);
  scan(map, from, {{{0.05, 0.05, 0.05}, RayEnd::kBlocked}});
  EXPECT_LT(map.log_odds({-0.05, 0.05, 0.05}), 0);
  EXPECT_EQ(map.log_odds({0.05, 0.05, 0.05}), 0);
  EXPECT_EQ(map.log_odds({0.15, 0.05, 0.05}), 0);
}

TEST(VoxelMap, CameraOutsideTheWindowClearsNothing) {
  VoxelMap map(small_config());
  scan(map, {-3.0, 0.05, 0.05},
       {{{0.05, 0.05, 0.05}, RayEnd::kSurface}, {{5.0, 0.05, 0.05}, RayEnd::kSurface}});
  EXPECT_FLOAT_EQ(map.log_odds({0.05, 0.05, 0.05}), kHit);
  for (double x = -0.95; x < 1.0; x += 0.1) {
    EXPECT_GE(map.log_odds({x, 0.05, 0.05}), 0);
  }
}

TEST(VoxelMap, UnknownBehindASurfaceIsSolidUntilSeen) {
  VoxelMapConfig config = small_config();
  config.solid_behind_m = 0.3;
  VoxelMap map(config);
  std::vector<std::uint8_t> mask(map.size());
  const Eigen::Vector3d from(-0.75, 0.05, 0.05), wall(0.05, 0.05, 0.05);
  const auto solid_at = [&](double x) {
    map.solid(mask.data());
    const Eigen::Vector3d p = (Eigen::Vector3d(x, 0.05, 0.05) - map.origin_W()) / kResolution;
    return mask[(static_cast<int>(p.z()) * 16 + static_cast<int>(p.y())) * 20 +
                static_cast<int>(p.x())] != 0;
  };
  scan(map, from, {{wall, RayEnd::kSurface}});
  EXPECT_FALSE(solid_at(0.15)) << "one hit is no surface yet";
  scan(map, from, {{wall, RayEnd::kSurface}});
  EXPECT_FALSE(solid_at(-0.05));
  EXPECT_TRUE(solid_at(0.05));
  EXPECT_TRUE(solid_at(0.15));
  EXPECT_TRUE(solid_at(0.25));
  EXPECT_TRUE(solid_at(0.35));
  EXPECT_FALSE(solid_at(0.45));
  EXPECT_EQ(map.log_odds({0.15, 0.05, 0.05}), 0.0f) << "still unknown";
  // Seen free from elsewhere, once: neither solid nor made solid again.
  scan(map, {0.15, -0.55, 0.05}, {{{0.15, 0.65, 0.05}, RayEnd::kSurface}});
  EXPECT_FALSE(solid_at(0.15));
  scan(map, from, {{wall, RayEnd::kSurface}});
  EXPECT_FALSE(solid_at(0.15));
  EXPECT_TRUE(solid_at(0.25));
}

}  // namespace
}  // namespace wb
