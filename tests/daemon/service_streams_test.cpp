// Facts about what the service publishes, read back by a plain DDS reader as any ROS 2 node would
// have it.
#include <cmath>
#include <map>
#include <set>

#include "daemon/service/dds.hpp"
#include "tests/daemon/service_fixture.hpp"

namespace wb {
namespace {

constexpr dds::Profile kBestEffort{false, false,
                                   50};  // of ROS's sensor readers; matches reliable writers

class StreamTest : public ServiceTest {
 protected:
  void SetUp() override {
    participant = dds::make_participant(domain(), "reader");
    ServiceSnapshot& s = shown;
    s.state.seq = 1;
    s.state.t_ns = kNow;
    s.state.mode = Mode::kActive;
    s.state.phase = Phase::kManipulate;
    s.state.joint_count = 2;
    s.state.q = {0.25, -0.5};
    s.state.dq = {1.25, -1.5};
    s.state.tau = {10, -20};
    s.state.base = {1.5, -2.5, 2.0};
    s.state.base_velocity = {0.5, 0.125, -0.25};
    s.state.gripper_opening_m = 0.0625;
    s.state.gripper_force_n = 40;
    s.object = Name("drawer");
    s.request = {7, RequestOutcome::kRunning, Phase::kManipulate, kNow, 0.125, 0.5, {}};
    s.plan_count = 2;
    s.plan_t_ns = {kNow, kNow + 1'500'000'000};
    s.plan[0] = {{1, 2, 3}, {0, 0, 0, 1}};
    s.plan[1] = {{4, 5, 6}, {1, 0, 0, 0}};
    s.loop_count = 1;
    s.loops[0] = {Name("control"), 4000, 3, 50, 90, 700};
    s.counter_count = 1;
    s.counters[0] = {Name("frames dropped"), 5};
    s.truth_joint_count = 2;
    s.truth_joints[0] = {Name("drawer"), 0.375};
    s.truth_joints[1] = {Name("not in the rules"), 1.0};
    s.truth_contact_count = 1;
    s.truth_contacts[0] = {Name("finger_left"), Name("drawer_handle")};
    started_ns = ros_now_ns();
    service = std::make_unique<Service>(options(), ports());
    offset_min_ns = started_ns - kNow;
    offset_max_ns = ros_now_ns() - kNow;
  }

  // Publishes new states until `check` has seen a sample; the check copies what it wants to keep.
  template <class T>
  bool receive(const std::string& topic, const std::function<void(const T&)>& check) {
    dds::Reader<T> reader(participant, topic, kBestEffort);
    bool seen = false;
    return wait_until([&] {
      publish();
      reader.take([&](const T& message) {
        if (!seen) check(message);
        seen = true;
      });
      return seen;
    });
  }

  // One nanosecond later than the state before, so that it counts as a new one.
  void publish() {
    shown.state.t_ns = kNow + ++published;
    snapshot.writing() = shown;
    snapshot.publish();
  }

  // A stamp on the wire is the snapshot's time, moved by the one offset that was taken at start.
  void expect_ros_time(const dds::msg::Time& time, TimeNs t_min_ns, TimeNs t_max_ns) {
    const std::int64_t ns = std::int64_t{time.sec_} * kNanosPerSecond + time.nanosec_;
    EXPECT_GE(ns, t_min_ns + offset_min_ns);
    EXPECT_LE(ns, t_max_ns + offset_max_ns);
    EXPECT_LT(time.nanosec_, 1'000'000'000u);
  }
  void expect_state_stamp(const dds::msg::Header& header, const char* frame) {
    expect_ros_time(header.stamp_, kNow, kNow + published);
    EXPECT_STREQ(header.frame_id_, frame);
  }

  dds::Entity participant;
  ServiceSnapshot shown;
  std::int64_t started_ns = 0, offset_min_ns = 0, offset_max_ns = 0;
  TimeNs published = 0;
};

TEST_F(StreamTest, JointStatesCarryJointsThenFingers) {
  ASSERT_TRUE(receive<dds::msg::JointState>("rt/joint_states", [&](const auto& m) {
    expect_state_stamp(m.header_, "");
    ASSERT_EQ(m.name_._length, 4u);
    ASSERT_EQ(m.position_._length, 4u);
    ASSERT_EQ(m.velocity_._length, 4u);
    ASSERT_EQ(m.effort_._length, 4u);
    const std::array<const char*, 4> names{"shoulder", "elbow", "finger_left", "finger_right"};
    const std::array<double, 4> q{0.25, -0.5, 0.03125, 0.03125}, dq{1.25, -1.5, 0, 0},
        tau{10, -20, 40, 40};
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_STREQ(m.name_._buffer[i], names[i]);
      EXPECT_EQ(m.position_._buffer[i], q[i]);
      EXPECT_EQ(m.velocity_._buffer[i], dq[i]);
      EXPECT_EQ(m.effort_._buffer[i], tau[i]);
    }
  }));
}

// sin and cos of half the yaw come from a rotation matrix and back: a few units in the last place.
constexpr double kRotationTolerance = 1e-14;

TEST_F(StreamTest, OdometryIsTheBaseInOdom) {
  ASSERT_TRUE(receive<dds::msg::Odometry>("rt/odom", [&](const auto& m) {
    expect_state_stamp(m.header_, "odom");
    EXPECT_STREQ(m.child_frame_id_, "base");
    EXPECT_EQ(m.pose_.pose_.position_.x_, 1.5);
    EXPECT_EQ(m.pose_.pose_.position_.y_, -2.5);
    EXPECT_EQ(m.pose_.pose_.position_.z_, 0);
    EXPECT_NEAR(m.pose_.pose_.orientation_.z_, std::sin(1.0), kRotationTolerance);
    EXPECT_NEAR(m.pose_.pose_.orientation_.w_, std::cos(1.0), kRotationTolerance);
    EXPECT_EQ(m.twist_.twist_.linear_.x_, 0.5);
    EXPECT_EQ(m.twist_.twist_.linear_.y_, 0.125);
    EXPECT_EQ(m.twist_.twist_.angular_.z_, -0.25);
  }));
}

TEST_F(StreamTest, TransformIsOdomToBase) {
  ASSERT_TRUE(receive<dds::msg::TFMessage>("rt/tf", [&](const auto& m) {
    ASSERT_EQ(m.transforms_._length, 1u);
    const auto& t = m.transforms_._buffer[0];
    expect_state_stamp(t.header_, "odom");
    EXPECT_STREQ(t.child_frame_id_, "base");
    EXPECT_EQ(t.transform_.translation_.x_, 1.5);
    EXPECT_EQ(t.transform_.translation_.y_, -2.5);
    EXPECT_NEAR(t.transform_.rotation_.z_, std::sin(1.0), kRotationTolerance);
    EXPECT_NEAR(t.transform_.rotation_.w_, std::cos(1.0), kRotationTolerance);
  }));
}

TEST_F(StreamTest, PlanIsTheHandsPathWithItsTimes) {
  ASSERT_TRUE(receive<dds::msg::Path>("rt/plan", [&](const auto& m) {
    EXPECT_STREQ(m.header_.frame_id_, "odom");
    ASSERT_EQ(m.poses_._length, 2u);
    expect_ros_time(m.poses_._buffer[0].header_.stamp_, kNow, kNow);
    expect_ros_time(m.poses_._buffer[1].header_.stamp_, kNow + 1'500'000'000, kNow + 1'500'000'000);
    EXPECT_EQ(m.poses_._buffer[1].pose_.position_.y_, 5);
    EXPECT_EQ(m.poses_._buffer[1].pose_.orientation_.x_, 1);
    EXPECT_EQ(m.poses_._buffer[1].pose_.orientation_.w_, 0);
  }));
}

TEST_F(StreamTest, StatusReachesTheClient) {
  publish();
  Client reader(domain(), "status");
  std::optional<DaemonStatus> status;
  ASSERT_TRUE(wait_until([&] {
    reader.wait(0.01);
    // The first beats may come before the snapshot.
    return (status = reader.take_status()) && status->mode == "active";
  }));
  EXPECT_EQ(status->phase, "manipulate");
  EXPECT_EQ(status->object, "drawer");
  EXPECT_EQ(status->outcome, "running");
  EXPECT_EQ(status->joint_value, 0.125);
  EXPECT_EQ(status->joint_range, 0.5);
  EXPECT_EQ(status->base, (std::array<double, 3>{1.5, -2.5, 2.0}));
  EXPECT_EQ(status->gripper_opening_m, 0.0625);
  ASSERT_EQ(status->loops.size(), 1u);
  EXPECT_EQ(status->loops[0].name, "control");
  EXPECT_EQ(status->loops[0].cycles, 4000u);
  EXPECT_EQ(status->loops[0].overruns, 3u);
  EXPECT_EQ(status->loops[0].p99_us, 90);
  ASSERT_EQ(status->counters.size(), 1u);
  EXPECT_EQ(status->counters[0].name, "frames dropped");
  EXPECT_EQ(status->counters[0].count, 5u);
}

TEST_F(StreamTest, DiagnosticsWarnOfOverrunsAndCountRefusals) {
  client = std::make_unique<Client>(domain(), "test");
  ASSERT_TRUE(client->wait_for_daemon(kPatienceS));
  const OperatorCommand bad = client->command("jump");
  ASSERT_TRUE(client->send(bad));
  ASSERT_EQ(next_ack(*client, bad).outcome, "refused");

  using Values = std::map<std::string, std::string>;
  std::map<std::string, std::pair<int, Values>> found;
  ASSERT_TRUE(receive<dds::msg::DiagnosticArray>("rt/diagnostics", [&](const auto& m) {
    for (std::uint32_t i = 0; i < m.status_._length; ++i) {
      const auto& status = m.status_._buffer[i];
      auto& entry = found[status.name_];
      entry.first = status.level_;
      for (std::uint32_t k = 0; k < status.values_._length; ++k) {
        entry.second[status.values_._buffer[k].key_] = status.values_._buffer[k].value_;
      }
    }
  }));
  EXPECT_EQ(found["wholebody/mode"].first, 0);
  EXPECT_EQ(found["wholebody/mode"].second["frames dropped"], "5");
  EXPECT_EQ(found["wholebody/loop/control"].first, 1);
  EXPECT_EQ(found["wholebody/loop/control"].second["overruns"], "3");
  EXPECT_GE(std::stoi(found["wholebody/commands"].second["refused: unknown verb"]), 1);
  EXPECT_EQ(found["wholebody/commands"].second["handed on"], "0");
}

TEST_F(StreamTest, TruthIsOnItsOwnTopics) {
  ASSERT_TRUE(receive<dds::msg::Float64>("rt/truth/drawer",
                                         [](const auto& m) { EXPECT_EQ(m.data_, 0.375); }));
  ASSERT_TRUE(receive<dds::msg::DiagnosticArray>("rt/truth/contacts", [](const auto& m) {
    ASSERT_EQ(m.status_._length, 1u);
    ASSERT_EQ(m.status_._buffer[0].values_._length, 1u);
    EXPECT_STREQ(m.status_._buffer[0].values_._buffer[0].key_, "finger_left");
    EXPECT_STREQ(m.status_._buffer[0].values_._buffer[0].value_, "drawer_handle");
  }));
}

TEST_F(StreamTest, AStateIsNeverPublishedTwice) {
  dds::Reader<dds::msg::JointState> reader(participant, "rt/joint_states", kBestEffort);
  ASSERT_TRUE(wait_until([&] { return reader.matched(); }));
  std::multiset<std::uint32_t> stamps;
  ASSERT_TRUE(wait_until([&] {
    // Fewer states than beats: each stays the newest for many of them.
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    publish();
    reader.take([&](const auto& m) { stamps.insert(m.header_.stamp_.nanosec_); });
    return stamps.size() >= 5;
  }));
  for (const std::uint32_t stamp : stamps) EXPECT_EQ(stamps.count(stamp), 1u);
}

template <class T>
void expect_ros_type(const char* name) {
  const dds_topic_descriptor_t* d = dds::descriptor<T>();
  EXPECT_STREQ(d->m_typename, name);
  EXPECT_EQ(d->m_nkeys, 0u) << name;
  // Without type information, peers with rosidl's member names still match (idlc -t).
  EXPECT_EQ(d->type_information.sz, 0u) << name;
}

TEST(WireTypes, AreNamedLikeRosAndHaveNeitherKeysNorTypeInformation) {
  expect_ros_type<dds::msg::JointState>("sensor_msgs::msg::dds_::JointState_");
  expect_ros_type<dds::msg::Odometry>("nav_msgs::msg::dds_::Odometry_");
  expect_ros_type<dds::msg::Path>("nav_msgs::msg::dds_::Path_");
  expect_ros_type<dds::msg::TFMessage>("tf2_msgs::msg::dds_::TFMessage_");
  expect_ros_type<dds::msg::DiagnosticArray>("diagnostic_msgs::msg::dds_::DiagnosticArray_");
  expect_ros_type<dds::msg::Float64>("std_msgs::msg::dds_::Float64_");
  expect_ros_type<dds::msg::Command>("wholebody_msgs::msg::dds_::Command_");
  expect_ros_type<dds::msg::CommandAck>("wholebody_msgs::msg::dds_::CommandAck_");
  expect_ros_type<dds::msg::Status>("wholebody_msgs::msg::dds_::Status_");
  expect_ros_type<dds::msg::Explanation>("wholebody_msgs::msg::dds_::Explanation_");
  expect_ros_type<dds::msg::Tuning>("wholebody_msgs::msg::dds_::Tuning_");
}

}  // namespace
}  // namespace wb
