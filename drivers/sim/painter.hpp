// Colours what a ray caster saw: flat shading by one lamp, with shadows where a shadow map was
// made. Step world. Frames: S world, C camera (optical).
#pragma once
#include <mujoco/mujoco.h>

#include <vector>

#include "drivers/sim/ray_caster.hpp"

namespace wb::sim {

class Painter {
 public:
  Painter(const mjModel& model, const Eigen::Vector3d& light_S);

  // The caster's last image as width * height * 3 bytes. `shadows`: a caster that looked from
  // shadow_pose(), or null.
  void paint(const RayCaster& caster, const GeomPoses& poses, const Eigen::Isometry3d& X_SC,
             const CameraIntrinsics& camera, std::uint8_t* rgb,
             const RayCaster* shadows = nullptr) const noexcept;

  // A camera in the lamp that looks straight down.
  Eigen::Isometry3d shadow_pose() const;
  static CameraIntrinsics shadow_camera();

 private:
  struct Look {
    int type = 0;
    Eigen::Vector3d size, rgb;
  };
  Eigen::Vector3d normal(const Look& look, const Eigen::Vector3d& p_G) const noexcept;
  bool shadowed(const RayCaster& shadows, const Eigen::Vector3d& p_S,
                const Eigen::Vector3d& n_S) const noexcept;

  std::vector<Look> looks_;
  Eigen::Vector3d light_S_;
};

}  // namespace wb::sim
