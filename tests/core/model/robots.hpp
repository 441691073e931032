// The robots that the model's tests run on: those of config/robots, and a fixed tree with what they
// lack (branches, oblique axes, turned inertias, mimic joints). Setup world.
#pragma once
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "core/model/robot_model.hpp"

namespace wb::test {

// Names of the folders in config/robots, sorted.
inline std::vector<std::string> robot_names() {
  std::vector<std::string> out;
  for (const auto& entry : std::filesystem::directory_iterator(WB_SOURCE_DIR "/config/robots")) {
    out.push_back(entry.path().filename());
  }
  std::sort(out.begin(), out.end());
  return out;
}

inline RobotConfig robot(const std::string& name) {
  return RobotConfig::load(std::filesystem::path(WB_SOURCE_DIR "/config/robots") / name);
}

inline RobotConfig mabi_mobile() {
  return RobotConfig::load(WB_SOURCE_DIR "/config/robots/mabi_mobile");
}

inline RobotConfig tree() {
  RobotConfig config;
  config.name = "tree";
  config.folder = std::filesystem::path(WB_BUILD_DIR) / "tests/core/model";
  config.urdf = config.folder / "tree.urdf";
  const std::string limit = R"(<limit lower="-1" upper="2" effort="10" velocity="3"/>)";
  const std::string inertial =
      R"(<inertial><origin xyz="0.1 -0.05 0.2" rpy="0.3 -0.2 0.5"/><mass value="1.5"/>
         <inertia ixx="0.02" ixy="0.001" ixz="-0.002" iyy="0.03" iyz="0.003" izz="0.025"/></inertial>)";
  // Tests run side by side: each writes its own file, and all of them put the same text in the same
  // place.
  const std::filesystem::path own = config.urdf.string() + std::to_string(getpid());
  std::ofstream(own)
      << R"(<robot name="tree"><link name="root">)" << inertial << "</link>"
      << R"(<link name="slide">)" << inertial << "</link>"
      << R"(<joint name="a" type="prismatic"><parent link="root"/><child link="slide"/>
            <origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><axis xyz="1 2 -1"/>)"
      << limit << "</joint>"
      << R"(<link name="plate">)" << inertial << "</link>"
      << R"(<joint name="plate_mount" type="fixed"><parent link="slide"/><child link="plate"/>
            <origin xyz="-0.1 0 0.4" rpy="1 0 0.2"/></joint>)"
      << R"(<link name="left">)" << inertial << "</link>"
      << R"(<joint name="b" type="revolute"><parent link="plate"/><child link="left"/>
            <origin xyz="0 0.3 0.1" rpy="0 -0.7 0"/><axis xyz="0 3 4"/>)"
      << limit << "</joint>"
      << R"(<link name="left_tip">)" << inertial << "</link>"
      << R"(<joint name="c" type="prismatic"><parent link="left"/><child link="left_tip"/>
            <origin xyz="0.5 0 0" rpy="0 0 1"/><axis xyz="0 0 1"/>)"
      << limit << "</joint>"
      << R"(<link name="right">)" << inertial << "</link>"
      << R"(<joint name="d" type="revolute"><parent link="slide"/><child link="right"/>
            <origin xyz="0 -0.3 0.1" rpy="0.2 0 0"/><axis xyz="-1 0 1"/>)"
      << limit << "</joint>"
      << R"(<link name="follower">)" << inertial << "</link>"
      << R"(<joint name="e" type="revolute"><parent link="right"/><child link="follower"/>
            <origin xyz="0.2 0.1 0" rpy="0 0.3 0"/><axis xyz="0 1 1"/>
            <mimic joint="b" multiplier="-1.5" offset="0.2"/>)"
      << limit << "</joint>"
      << R"(<link name="spinner">)" << inertial << "</link>"
      << R"(<joint name="f" type="continuous"><parent link="follower"/><child link="spinner"/>
            <origin xyz="0 0.1 0.2" rpy="0.1 0 0.5"/><axis xyz="1 0 2"/>
            <limit effort="10" velocity="3"/></joint>)"
      << R"(<link name="slider">)" << inertial << "</link>"
      << R"(<joint name="g" type="prismatic"><parent link="left_tip"/><child link="slider"/>
            <origin xyz="0 0.1 0" rpy="0 0.3 0"/><axis xyz="0 1 0"/>
            <mimic joint="c" multiplier="0.5" offset="-0.1"/>)"
      << limit << "</joint></robot>";
  std::filesystem::rename(own, config.urdf);
  config.base.link = "root";
  for (const char* name : {"a", "b", "c", "d", "f"}) config.joints.push_back({name, 5.0});
  config.end_effector = "left_tip";
  return config;
}

// A state with its joints anywhere within their limits and the base anywhere within 5 m.
inline StateVector random_state(const RobotModel& model, std::mt19937& random) {
  StateVector x(model.nx());
  for (int i = 0; i < model.base_dof(); ++i) {
    x[i] = std::uniform_real_distribution(-5.0, 5.0)(random);
  }
  for (int i = 0; i < model.joints(); ++i) {
    const JointLimits& l = model.limits(i);
    const double low = l.endless() ? -7.0 : l.lower, high = l.endless() ? 7.0 : l.upper;
    x[model.base_dof() + i] = std::uniform_real_distribution(low, high)(random);
  }
  return x;
}

inline JointVector random_rates(const RobotModel& model, std::mt19937& random) {
  JointVector out(model.joints());
  for (double& rate : out) rate = std::normal_distribution()(random);
  return out;
}

}  // namespace wb::test
