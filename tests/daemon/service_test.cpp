// Facts about commands and acknowledgements over DDS: a client and the service are two participants
// on loopback.
#include <limits>
#include <ostream>

#include "tests/daemon/service_fixture.hpp"

namespace wb {
namespace {

TEST_F(ServiceTest, ValidCommandReachesControllerOnceAndIsAcknowledged) {
  start();
  OperatorCommand command = client->command("open");
  command.object = "drawer";
  command.opened_fraction = 0.75;
  ASSERT_TRUE(client->send(command));

  const Request request = next_request();
  EXPECT_EQ(request.kind, RequestKind::kOpen);
  EXPECT_EQ(request.object.view(), "drawer");
  EXPECT_EQ(request.opened_fraction, 0.75);
  EXPECT_EQ(request.t_ns, kNow);
  EXPECT_NE(request.id, 0u);

  answer(request, RequestOutcome::kAccepted);
  EXPECT_EQ(next_ack(*client, command).outcome, "accepted");
  answer(request, RequestOutcome::kRunning, kNow + 1, Phase::kGrasp);
  const OperatorAck running = next_ack(*client, command);
  EXPECT_EQ(running.outcome, "running");
  EXPECT_EQ(running.phase, "grasp");
  EXPECT_EQ(running.joint_value, 0.125);
  EXPECT_EQ(running.joint_range, 0.5);
  answer(request, RequestOutcome::kFailed, kNow + 2, Phase::kFailed, "handle lost");
  const OperatorAck failed = next_ack(*client, command);
  EXPECT_EQ(failed.outcome, "failed");
  EXPECT_EQ(failed.reason, "handle lost");
  EXPECT_TRUE(failed.final());

  EXPECT_EQ(requests.peek(), nullptr);
  EXPECT_EQ(service->accepted(), 1u);
}

TEST_F(ServiceTest, JointAndBaseValuesArriveUnchanged) {
  start();
  OperatorCommand joints = client->command("move_joints");
  joints.values = {0.3, -1.7};
  ASSERT_TRUE(client->send(joints));
  const Request q = next_request();
  EXPECT_EQ(q.kind, RequestKind::kMoveJoints);
  ASSERT_EQ(q.joint_count, 2);
  EXPECT_EQ(q.q[0], 0.3);
  EXPECT_EQ(q.q[1], -1.7);

  OperatorCommand base = client->command("move_base");
  base.values = {1.5, -2.5, 0.5};
  ASSERT_TRUE(client->send(base));
  const Request goal = next_request();
  EXPECT_EQ(goal.kind, RequestKind::kMoveBase);
  EXPECT_EQ(goal.base, (std::array<double, 3>{1.5, -2.5, 0.5}));
}

struct BadCommand {
  const char* name;
  Refusal refusal;
  const char* reason_part;
  void (*spoil)(OperatorCommand&);
};
std::ostream& operator<<(std::ostream& out, const BadCommand& bad) { return out << bad.name; }

class BadCommandTest : public ServiceTest, public ::testing::WithParamInterface<BadCommand> {};

TEST_P(BadCommandTest, IsRefusedWithItsReasonAndReachesNobody) {
  start();
  OperatorCommand command = client->command("open");
  command.object = "drawer";
  GetParam().spoil(command);
  ASSERT_TRUE(client->send(command));
  const OperatorAck ack = next_ack(*client, command);
  EXPECT_EQ(ack.outcome, "refused");
  EXPECT_NE(ack.reason.find(GetParam().reason_part), std::string::npos) << ack.reason;
  EXPECT_GE(service->refused(GetParam().refusal), 1u);
  EXPECT_EQ(service->accepted(), 0u);
  EXPECT_EQ(requests.peek(), nullptr);
}

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

INSTANTIATE_TEST_SUITE_P(
    Each, BadCommandTest,
    ::testing::Values(
        BadCommand{"NoClient", Refusal::kNoClient, "no client",
                   [](OperatorCommand& c) { c.client = ""; }},
        BadCommand{"UnknownVerb", Refusal::kUnknownVerb, "no verb 'jump'",
                   [](OperatorCommand& c) { c.verb = "jump"; }},
        BadCommand{"EmptyObject", Refusal::kUnknownObject, "no object given; known: drawer, oven",
                   [](OperatorCommand& c) { c.object = ""; }},
        BadCommand{"UnknownObject", Refusal::kUnknownObject, "no object 'fridge'",
                   [](OperatorCommand& c) { c.object = "fridge"; }},
        BadCommand{"ObjectLongerThanAnyName", Refusal::kUnknownObject, "no object",
                   [](OperatorCommand& c) { c.object = std::string(64, 'd'); }},
        BadCommand{"FractionNotANumber", Refusal::kNotFinite, "not finite",
                   [](OperatorCommand& c) { c.opened_fraction = kNaN; }},
        BadCommand{"FractionAboveOne", Refusal::kOutOfRange, "outside 0 .. 1",
                   [](OperatorCommand& c) { c.opened_fraction = 1.01; }},
        BadCommand{"FractionNegative", Refusal::kOutOfRange, "outside 0 .. 1",
                   [](OperatorCommand& c) { c.opened_fraction = -0.01; }},
        BadCommand{"StampTooOld", Refusal::kStale, "older",
                   [](OperatorCommand& c) { c.stamp_ns -= 3 * kNanosPerSecond; }},
        BadCommand{"StampFromTheFuture", Refusal::kStale, "future",
                   [](OperatorCommand& c) { c.stamp_ns += 60 * kNanosPerSecond; }},
        BadCommand{"JointInfinite", Refusal::kNotFinite, "not finite",
                   [](OperatorCommand& c) {
                     c.verb = "move_joints", c.values = {0, kInfinity};
                   }},
        BadCommand{"JointBeyondItsLimit", Refusal::kOutOfRange, "joint 1 at 2.5",
                   [](OperatorCommand& c) {
                     c.verb = "move_joints", c.values = {0, 2.5};
                   }},
        BadCommand{"JointMissing", Refusal::kWrongCount, "takes 2 values, got 1",
                   [](OperatorCommand& c) { c.verb = "move_joints", c.values = {0}; }},
        BadCommand{"BaseTooFar", Refusal::kOutOfRange, "m away",
                   [](OperatorCommand& c) {
                     c.verb = "move_base", c.values = {0, -51, 0};
                   }},
        BadCommand{"BaseWithoutYaw", Refusal::kWrongCount, "x, y, yaw",
                   [](OperatorCommand& c) {
                     c.verb = "move_base", c.values = {0, 1};
                   }}),
    [](const auto& info) { return std::string(info.param.name); });

TEST_F(ServiceTest, DuplicateIsRefusedAndChangesNothing) {
  start();
  OperatorCommand command = client->command("stop");
  ASSERT_TRUE(client->send(command));
  const Request request = next_request();
  answer(request, RequestOutcome::kSucceeded);
  ASSERT_EQ(next_ack(*client, command).outcome, "succeeded");

  // Another client repeats it, and a third one looks on: a client hides what its own repetitions
  // bring.
  Client other(domain(), "other"), observer(domain(), "observer");
  ASSERT_TRUE(other.wait_for_daemon(kPatienceS));
  ASSERT_TRUE(other.send(command));
  ASSERT_TRUE(wait_until([&] {
    other.wait(0);
    return service->refused(Refusal::kDuplicate) >= 1;
  }));
  EXPECT_TRUE(wait_until([&] { return next_ack(observer, command).reason == kDuplicateReason; }));
  EXPECT_EQ(requests.peek(), nullptr);
  EXPECT_EQ(service->accepted(), 1u);

  // The same number from another client is another request.
  OperatorCommand own = command;
  own.client = other.id();
  ASSERT_TRUE(other.send(own));
  ASSERT_TRUE(wait_until([&] {
    other.wait(0);
    return service->accepted() == 2;
  }));
}

TEST_F(ServiceTest, FullQueueRefusesAndTheCommandMayBeSentAgain) {
  start();
  for (std::size_t i = 0; i < requests.capacity(); ++i) {
    ASSERT_TRUE(client->send(client->command("stop")));
  }
  ASSERT_TRUE(wait_until([&] {
    client->wait(0);
    return service->accepted() == requests.capacity();
  }));
  const OperatorCommand command = client->command("reset");
  ASSERT_TRUE(client->send(command));
  const OperatorAck ack = next_ack(*client, command);
  EXPECT_EQ(ack.outcome, "refused");
  EXPECT_NE(ack.reason.find("full"), std::string::npos);

  Request request;
  while (requests.pop(request)) {
  }
  ASSERT_TRUE(client->send(command));
  EXPECT_EQ(next_request().kind, RequestKind::kReset);
}

TEST_F(ServiceTest, LateClientReceivesLatchedAcknowledgement) {
  start();
  const OperatorCommand command = client->command("reset");
  ASSERT_TRUE(client->send(command));
  answer(next_request(), RequestOutcome::kSucceeded);
  ASSERT_EQ(next_ack(*client, command).outcome, "succeeded");

  Client late(domain(), "late");
  EXPECT_EQ(next_ack(late, command).outcome, "succeeded");
}

TEST_F(ServiceTest, ProgressIsThinnedToTenAcknowledgementsASecond) {
  start();
  const OperatorCommand command = client->command("stop");
  ASSERT_TRUE(client->send(command));
  const Request request = next_request();
  // 0.2 s of control at 1 kHz: told at 0, 0.1 and 0.2 s, and the end.
  for (int i = 0; i <= 200; ++i) {
    answer(request, RequestOutcome::kRunning, kNow + i * 1'000'000);
  }
  answer(request, RequestOutcome::kSucceeded, kNow + 200'500'000);
  int running = 0;
  OperatorAck ack;
  while (!(ack = next_ack(*client, command)).final()) ++running;
  EXPECT_EQ(ack.outcome, "succeeded");
  EXPECT_EQ(running, 3);
}

TEST_F(ServiceTest, StampsAreRosTimeOffsetByTheClockAtStart) {
  const std::int64_t before_ns = ros_now_ns();
  start();
  const std::int64_t after_ns = ros_now_ns();
  const OperatorCommand command = client->command("stop");
  ASSERT_TRUE(client->send(command));
  answer(next_request(), RequestOutcome::kSucceeded, kNow + 7);
  const OperatorAck ack = next_ack(*client, command);
  // The clock stood at kNow when the service started.
  EXPECT_GE(ack.stamp_ns, before_ns + 7);
  EXPECT_LE(ack.stamp_ns, after_ns + 7);
}

TEST_F(ServiceTest, BadOptionsAreRefusedAtSetup) {
  ServiceOptions never = options();
  never.plan_every = 0;
  EXPECT_THROW(Service(never, ports()), std::runtime_error);
  ServiceOptions motionless = options();
  motionless.rate_hz = 0;
  EXPECT_THROW(Service(motionless, ports()), std::runtime_error);
}

}  // namespace
}  // namespace wb
