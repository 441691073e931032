// A paced robot: virtual time that goes on by ticks, frames and truth that belong to them.
#include <array>
#include <cmath>
#include <vector>

#include "tests/drivers/dds/dds_fixture.hpp"
#include "tests/drivers/dds/seeing_robot.hpp"

namespace wb::dds {
namespace {

constexpr TimeNs kTick = 2'500'000;

class PacedTest : public DdsDriverTest {
 protected:
  void SetUp() override {
    LowLevelOptions o = low_level_options(true);
    o.cameras = {SeeingRobot::camera()};
    low = std::make_unique<LowLevel>(o, fake_description(), seeing);
    seeing.low_level = low.get();
    thread = std::thread([this] {
      while (!stopping) {
        hangs = paused.load();
        hangs ? sleep_s(0.001) : low->spin(5'000'000);
      }
    });
  }
  void TearDown() override {
    plugin.reset();
    stopping = true;
    thread.join();
  }
  static std::string everything(const std::string& more = "", int tick_timeout_ms = 20'000) {
    return config(true, SeeingRobot::kConfig + more, tick_timeout_ms);
  }

  SeeingRobot seeing;
  std::unique_ptr<LowLevel> low;
  std::atomic<bool> stopping{false}, paused{false}, hangs{false};
  std::thread thread;
};

TEST_F(PacedTest, EveryTicksMeasurementsFramesAndTruthAreThereWhenAdvanceReturns) {
  plugin = std::make_unique<Plugin>(everything());
  EXPECT_EQ(plugin->description.can_step, 1u);
  const auto* truth =
      static_cast<const wb_sim_truth*>(plugin->api().get_extension(plugin->get(), WB_SIM_TRUTH));
  ASSERT_NE(truth, nullptr);
  int frames = 0;
  for (TimeNs t = 0; t <= 200'000'000; t += kTick) {
    ASSERT_EQ(plugin->advance(t), WB_OK);
    ASSERT_EQ(plugin->read(), WB_OK);
    EXPECT_EQ(plugin->readings.t_ns, t);
    EXPECT_EQ(truth->time_ns(plugin->get()), t / 10'000'000 * 10'000'000);
    wb_frame frame;
    while (plugin->api().acquire_frame(plugin->get(), &frame) == WB_OK) {
      EXPECT_EQ(frame.t_ns, t);
      EXPECT_EQ(frame.t_ns % 20'000'000, 0);
      EXPECT_FLOAT_EQ(frame.depth[0], frame.t_ns == 0 ? std::numeric_limits<float>::infinity()
                                                      : static_cast<float>(to_seconds(t)));
      EXPECT_TRUE(std::isinf(frame.depth[1]));
      EXPECT_EQ(plugin->api().release_frame(plugin->get(), frame.token), WB_OK);
      EXPECT_EQ(plugin->api().release_frame(plugin->get(), frame.token), WB_ERROR);
      ++frames;
    }
  }
  EXPECT_EQ(frames, 11);
}

TEST_F(PacedTest, CommandsTakeEffectInTheTickThatFollowsThem) {
  // Twice with a new session each: the robot must do the same to the last bit.
  std::vector<double> first;
  for (int run = 0; run < 2; ++run) {
    plugin = std::make_unique<Plugin>(everything());
    ASSERT_EQ(plugin->activate(), WB_OK);
    std::vector<double> positions;
    const double start = seeing.position(0);
    for (TimeNs t = kTick; t <= 100 * kTick; t += kTick) {
      const double speed = 0.5 * std::sin(0.1 * static_cast<double>(t / kTick));
      ASSERT_EQ(plugin->write(velocity_commands(5, speed)), WB_OK);
      ASSERT_EQ(plugin->advance(t), WB_OK);
      ASSERT_EQ(plugin->read(), WB_OK);
      EXPECT_DOUBLE_EQ(plugin->readings.joints[0].velocity, speed) << "at tick " << t / kTick;
      positions.push_back(plugin->readings.joints[0].position - start);
    }
    plugin.reset();
    if (run == 0) first = positions;
    if (run == 1) {
      ASSERT_EQ(first.size(), positions.size());
      for (std::size_t i = 0; i < first.size(); ++i) EXPECT_NEAR(first[i], positions[i], 1e-15);
    }
  }
}

TEST_F(PacedTest, TheTimeOutIsKeptToTheNanosecondOfVirtualTime) {
  plugin = std::make_unique<Plugin>(everything());
  ASSERT_EQ(plugin->activate(51'000'000), WB_OK);
  ASSERT_EQ(plugin->advance(100'000'000), WB_OK);
  ASSERT_EQ(plugin->write(velocity_commands(5, 1)), WB_OK);
  sleep_s(0.1);  // the wall's time has no part in it
  ASSERT_EQ(plugin->advance(150'000'000), WB_OK);
  EXPECT_EQ(seeing.stops(), 0);
  ASSERT_EQ(plugin->advance(300'000'000), WB_OK);
  EXPECT_EQ(seeing.stops(), 1);
  EXPECT_EQ(seeing.stopped_t_ns(), 151'000'000);
  EXPECT_NEAR(seeing.position(0), 0.051, 1e-12);
  ASSERT_EQ(plugin->read(), WB_OK);
  EXPECT_TRUE(plugin->readings.timed_out);
  EXPECT_EQ(plugin->write(velocity_commands(5, 1)), WB_TIMED_OUT);
}

TEST_F(PacedTest, TruthSaysWhatTheTableOfTheSimulatorSays) {
  plugin = std::make_unique<Plugin>(everything());
  wb_driver* d = plugin->get();
  const auto* truth =
      static_cast<const wb_sim_truth*>(plugin->api().get_extension(d, WB_SIM_TRUTH));
  ASSERT_NE(truth, nullptr);
  ASSERT_EQ(plugin->advance(30'000'000), WB_OK);
  EXPECT_DOUBLE_EQ(truth->base_pose(d).p[0], 0.03);
  EXPECT_DOUBLE_EQ(truth->spawn_pose(d).p[1], 2);
  ASSERT_EQ(truth->object_count(d), 1u);
  wb_sim_object o;
  ASSERT_EQ(truth->object(d, 0, &o), WB_OK);
  EXPECT_STREQ(o.name, "drawer_1");
  EXPECT_DOUBLE_EQ(o.range, 0.45);
  EXPECT_EQ(truth->object(d, 1, &o), WB_ERROR);
  ASSERT_EQ(truth->contact_count(d), 1u);
  wb_sim_contact c;
  ASSERT_EQ(truth->contact(d, 0, &c), WB_OK);
  EXPECT_STREQ(c.other_geom, "door");
  EXPECT_STREQ(c.object, "oven");
  EXPECT_EQ(truth->contact(d, 1, &c), WB_ERROR);
  EXPECT_DOUBLE_EQ(truth->clearance(d, "drawer_1"), 0.125);
  EXPECT_DOUBLE_EQ(truth->clearance(d, nullptr), 0.0625);
  EXPECT_TRUE(std::isnan(truth->clearance(d, "nothing")));
  wb_sim_pose X;
  ASSERT_EQ(truth->link_pose(d, "camera_shoulder", &X), WB_OK);
  EXPECT_DOUBLE_EQ(X.p[2], 1.5);
  EXPECT_EQ(truth->link_pose(d, "tail", &X), WB_ERROR);
  ASSERT_EQ(truth->hand_in_handle(d, 0, &X), WB_OK);
  EXPECT_DOUBLE_EQ(X.p[0], 0.25);
}

TEST_F(PacedTest, ThePluginKnowsNoTruthUnlessItIsConfigured) {
  plugin = std::make_unique<Plugin>(config(true));
  EXPECT_EQ(plugin->api().get_extension(plugin->get(), WB_SIM_TRUTH), nullptr);
}

TEST_F(PacedTest, ARobotThatHangsMakesAdvanceFailInBoundedTimeAndComesBack) {
  plugin = std::make_unique<Plugin>(everything("", 300));
  ASSERT_EQ(plugin->advance(10'000'000), WB_OK);
  paused = true;
  ASSERT_TRUE(wait_until([&] { return hangs.load(); }));
  EXPECT_EQ(plugin->advance(2'000'000'000), WB_TIMED_OUT);
  EXPECT_EQ(plugin->read(), WB_ERROR) << "what is there is older than silence_ms";
  EXPECT_EQ(plugin->count("ticks.unanswered"), 1u);
  paused = false;
  TimeNs t = 2'000'000'000;
  EXPECT_TRUE(wait_until([&] { return plugin->advance(t += kTick) == WB_OK; }));
  EXPECT_EQ(plugin->read(), WB_OK);
  EXPECT_EQ(plugin->readings.t_ns, t);
}

TEST_F(PacedTest, ASecondHostCannotTurnTheClock) {
  plugin = std::make_unique<Plugin>(everything());
  ASSERT_EQ(plugin->advance(10'000'000), WB_OK);
  std::atomic<bool> done{false};
  std::thread first([&] {
    for (TimeNs t = 10'000'000; !done; t += kTick) plugin->advance(t);
  });
  EXPECT_THROW(Plugin(everything(", connect_timeout_ms: 500")), std::runtime_error);
  done = true;
  first.join();
  EXPECT_GT(low->counts().refused_ticks, 0u);
}

TEST_F(PacedTest, TheClockMustBeConfiguredAsTheRobotHasIt) {
  try {
    Plugin wrong(config(false));
    FAIL() << "it started";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("is paced"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace wb::dds
