// Wheel speeds and body twists against rigid-body motion of each wheel's centre.
#include "core/model/wheel_kinematics.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "tests/core/model/robots.hpp"

namespace wb {
namespace {

class WheelsOf : public ::testing::TestWithParam<std::string> {
 protected:
  const BaseConfig base = test::robot(GetParam()).base;
  const WheelKinematics wheels{base};
};
INSTANTIATE_TEST_SUITE_P(Robots, WheelsOf, ::testing::ValuesIn(test::robot_names()),
                         [](const auto& info) { return info.param; });

TEST_P(WheelsOf, SpeedsOfATwistGiveTheTwistBack) {
  EXPECT_EQ(wheels.wheels(), static_cast<int>(base.wheels.size()));
  const bool sideways = base.kind == BaseKind::kOmnidirectional;
  const bool drives = base.kind != BaseKind::kFixed;
  const WheelKinematics::Twist v = {0.3, sideways ? -0.2 : 0.0, 0.7};
  const WheelKinematics::Twist back = wheels.twist(wheels.wheel_speeds(v));
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(back[i], drives ? v[i] : 0.0, 1e-15) << i;
}

TEST(WheelKinematics, NoRollerOfAMecanumWheelSlipsAlongItsAxis) {
  const BaseConfig base = test::robot("ridgeback_ur5").base;
  const WheelKinematics wheels(base);
  const double x = 0.5 * base.wheelbase_m, y = 0.5 * base.track_m;
  const Eigen::Vector2d centre[] = {{x, y}, {x, -y}, {-x, y}, {-x, -y}};
  const Eigen::Vector2d roller[] = {{1, -1}, {1, 1}, {1, 1}, {1, -1}};  // an X seen from above
  for (const WheelKinematics::Twist& v :
       {WheelKinematics::Twist{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.3, -0.5, 0.8}}) {
    const WheelKinematics::Wheels speed = wheels.wheel_speeds(v);
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector2d of_centre(v[0] - v[2] * centre[i].y(), v[1] + v[2] * centre[i].x());
      const Eigen::Vector2d of_contact =
          of_centre - Eigen::Vector2d(base.wheel_radius_m * speed[i], 0);
      EXPECT_NEAR(roller[i].dot(of_contact), 0, 1e-15) << i;
    }
  }
}

// Four speeds for three velocities: what no twist explains is left out as least squares leave it.
TEST(WheelKinematics, TwistOfMecanumWheelsIsTheLeastSquaresSolution) {
  const WheelKinematics wheels(test::robot("ridgeback_ur5").base);
  Eigen::Matrix<double, 4, 3> J;
  for (int k = 0; k < 3; ++k) {
    WheelKinematics::Twist unit{};
    unit[k] = 1;
    J.col(k) = Eigen::Map<const Eigen::Vector4d>(wheels.wheel_speeds(unit).data());
  }
  const WheelKinematics::Wheels speeds = {3, -1, 4, 1.5};
  const Eigen::Vector3d expected =
      J.colPivHouseholderQr().solve(Eigen::Map<const Eigen::Vector4d>(speeds.data()));
  const WheelKinematics::Twist v = wheels.twist(speeds);
  EXPECT_LE((Eigen::Vector3d(v[0], v[1], v[2]) - expected).norm(), 1e-14);
}

}  // namespace
}  // namespace wb
