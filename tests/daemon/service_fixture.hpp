// A Service with a stand-in for the controller behind the real buffers, in a DDS domain of this
// process's own on loopback. The test's thread plays the controller: it pops requests, pushes
// statuses, publishes snapshots.
#pragma once
#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <string>

#include "core/rt/latest.hpp"
#include "core/rt/queue.hpp"
#include "daemon/service/client.hpp"
#include "daemon/service/service.hpp"
#include "tests/dds_domain.hpp"

namespace wb {

using test::kPatienceS, test::wait_until;

class ServiceTest : public ::testing::Test {
 protected:
  static constexpr TimeNs kNow = 5 * kNanosPerSecond;  // a virtual clock that stands still

  static int domain() {
    static const int own = test::own_dds_domain();
    return own;
  }

  static ServiceOptions options() {
    ServiceOptions options;
    options.domain = domain();
    options.rules.objects = {"drawer", "oven"};
    options.rules.joints = {{-1, 1, 1, 1, 1}, {-2, 2, 1, 1, 1}};
    options.joint_names = {"shoulder", "elbow"};
    options.finger_names = {"finger_left", "finger_right"};
    options.rules.weights = {{"end_effector.position_pm2", 80, 0, 8000}};
    options.rules.terms = {"end_effector", "environment"};
    options.truth = true;
    options.explanation_every = 1;
    options.diagnostics_every = 5;  // a test does not wait for a second
    return options;
  }

  ServicePorts ports() {
    return {[] { return kNow; }, [this](const Request& r) { return requests.push(r); },
            [this](RequestStatus& s) { return statuses.pop(s); },
            [this] { return snapshot.read(); },
            [this](DaemonExplanation& e) {
              if (explanation_pending) e = explanation;
              return explanation_pending.exchange(false);
            }};
  }

  void start() {
    service = std::make_unique<Service>(options(), ports());
    client = std::make_unique<Client>(domain(), "test");
    ASSERT_TRUE(client->wait_for_daemon(kPatienceS));
  }

  // The next acknowledgement of a command, whoever sent it; an empty one if none came.
  static OperatorAck next_ack(Client& client, const OperatorCommand& command) {
    OperatorAck found;
    wait_until([&] {
      client.wait(0.01);
      while (const auto ack = client.take_acknowledgement()) {
        if (ack->request_id == command.request_id && ack->client == command.client) {
          found = *ack;
          return true;
        }
      }
      return false;
    });
    return found;
  }

  // The next request that reaches the controller; kind kNone if none came.
  Request next_request() {
    Request request;
    wait_until([&] {
      client->wait(0);  // repeats a command that discovery lost
      return requests.pop(request);
    });
    return request;
  }

  void answer(const Request& request, RequestOutcome outcome, TimeNs t_ns = kNow,
              Phase phase = Phase::kNone, const char* reason = "") {
    ASSERT_TRUE(statuses.push({request.id, outcome, phase, t_ns, 0.125, 0.5, Name(reason)}));
  }

  Queue<Request, 2> requests;
  Queue<RequestStatus, 256> statuses;
  Latest<ServiceSnapshot> snapshot;
  DaemonExplanation explanation;  // written before it is pending
  std::atomic<bool> explanation_pending{false};
  std::unique_ptr<Service> service;
  std::unique_ptr<Client> client;
};

}  // namespace wb
