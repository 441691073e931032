#include "daemon/run_observer.hpp"

#include <stdexcept>

namespace wb {

double RunObserver::threshold(const std::string& object) {
  if (object.starts_with("oven")) return 0.60;
  if (object.starts_with("washing_machine")) return 0.75;
  return 0.65;
}

namespace {

// Where to look at a grasp from: along the bar, from the right of who faces the front, a little out
// and above.
Eigen::Isometry3d close_up(const Eigen::Isometry3d& X_SG) {
  const Eigen::Vector3d into = X_SG.linear().col(2), right = into.cross(Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d from = -0.15 * into + 0.42 * right + 0.12 * Eigen::Vector3d::UnitZ();
  Eigen::Isometry3d X_SC;
  const Eigen::Vector3d z = -from.normalized(), x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  X_SC.linear() << x, z.cross(x), z;
  X_SC.translation() = X_SG.translation() + from;
  return X_SC;
}

}  // namespace

RunObserver::RunObserver(System& system, const std::string& object, double threshold_fraction)
    : system_(system),
      truth_(static_cast<const wb_sim_truth*>(system.host().extension(WB_SIM_TRUTH, &driver_))),
      view_(static_cast<const wb_sim_view*>(system.host().extension(WB_SIM_VIEW, nullptr))),
      object_(object),
      threshold_(threshold_fraction) {
  if (!truth_)
    throw std::runtime_error("watching a run needs a driver with the extension " WB_SIM_TRUTH);
  wb_sim_object o;
  for (index_ = 0; index_ < truth_->object_count(driver_); ++index_) {
    if (truth_->object(driver_, index_, &o) == WB_OK && object == o.name) return;
  }
  throw std::runtime_error("the scene has no object '" + object + "'");
}

RunObserver::~RunObserver() {
  if (csv_) std::fclose(csv_);
}

void RunObserver::write_to(const std::filesystem::path& folder) {
  folder_ = folder;
  std::filesystem::create_directories(folder);
  csv_ = std::fopen((folder / "run.csv").c_str(), "w");
  if (!csv_) throw std::runtime_error((folder / "run.csv").string() + " cannot be written");
  std::fprintf(csv_,
               "t_s,phase,joint_value,base_x_m,base_y_m,hand_x_m,hand_y_m,hand_z_m,clearance_m,"
               "collisions\n");
  picture("start");
}

void RunObserver::picture(const std::string& name, const Eigen::Isometry3d* X_SC) const {
  if (!view_ || folder_.empty()) return;
  constexpr int kWidth = 960, kHeight = 720;
  std::vector<std::uint8_t> rgb(3 * kWidth * kHeight);
  const wb_sim_pose pose = X_SC ? sim_pose(*X_SC) : wb_sim_pose{};
  if (view_->render(driver_, kWidth, kHeight, X_SC ? &pose : nullptr, 0.0, rgb.data()) != WB_OK)
    return;
  if (std::FILE* f = std::fopen((folder_ / (name + ".ppm")).c_str(), "wb")) {
    std::fprintf(f, "P6 %d %d 255\n", kWidth, kHeight);
    std::fwrite(rgb.data(), 1, rgb.size(), f);
    std::fclose(f);
  }
}

void RunObserver::sample(TimeNs t) {
  if (t < next_) return;
  next_ = t + 10'000'000;
  wb_sim_object o;
  if (truth_->object(driver_, index_, &o) != WB_OK) return;
  RunResult& r = result_;
  r.opened_value = o.value;
  r.range = o.range;
  r.revolute = o.is_revolute;
  r.opened_fraction = std::max(r.opened_fraction, o.value / o.range);
  if (!r.opened && o.value >= threshold_ * o.range) {
    r.opened = true;
    r.time_s = to_seconds(t - start_);
  }

  wb_sim_pose hand;
  if (truth_->link_pose(driver_, system_.model().config().end_effector.c_str(), &hand) == WB_OK) {
    const Eigen::Vector3d p = isometry(hand).translation();
    if (have_hand_) r.ee_path_m += (p - last_hand_).norm();
    last_hand_ = p;
    have_hand_ = true;
  }
  const Phase phase = system_.state().phase;
  if (phase == Phase::kManipulate) {
    wb_sim_pose pose;
    if (truth_->hand_in_handle(driver_, index_, &pose) == WB_OK) {
      const Eigen::Isometry3d X_GE = isometry(pose);
      if (!grasped_) {
        X_GE_grasp_ = X_GE;
        grasped_ = true;
        picture("grasp");
        const Eigen::Isometry3d X_SC = close_up(isometry(o.X_SG));
        picture("hand", &X_SC);
      }
      r.slip_m = std::max(r.slip_m, (X_GE.translation() - X_GE_grasp_.translation()).norm());
    }
  } else {
    grasped_ = false;
  }
  if (t >= next_clearance_) {
    next_clearance_ = t + 100'000'000;
    clearance_ = truth_->clearance(driver_, object_.c_str());
    r.min_clearance_m = std::min(r.min_clearance_m, clearance_);
  }
  r.collisions = static_cast<int>(truth_->contact_count(driver_));
  if (r.collisions && r.first_collision.empty()) {
    wb_sim_contact c;
    if (truth_->contact(driver_, 0, &c) == WB_OK) {
      char text[160];
      std::snprintf(text, sizeof text, "%s against %s in %s at %.2f s", c.robot_geom, c.other_geom,
                    std::string(to_string(phase)).c_str(), to_seconds(c.t_ns - start_));
      r.first_collision = text;
    }
  }
  if (csv_) {
    const Eigen::Vector3d base = isometry(truth_->base_pose(driver_)).translation();
    std::fprintf(csv_, "%.3f,%s,%.5f,%.4f,%.4f,%.4f,%.4f,%.4f,%.4f,%d\n", to_seconds(t - start_),
                 std::string(to_string(phase)).c_str(), o.value, base.x(), base.y(), last_hand_.x(),
                 last_hand_.y(), last_hand_.z(), clearance_, r.collisions);
  }
}

void RunObserver::finish() {
  picture("open");
  if (csv_) std::fclose(csv_);
  csv_ = nullptr;
}

}  // namespace wb
