// The operator's side of the DDS edge: sends commands, receives acknowledgements and status. Used
// by wbctl and tests. World: jobs (one ordinary thread calls it). No DDS types here.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "daemon/service/operator_messages.hpp"

namespace wb {

class Client {
 public:
  // Throws config::ConfigError. The client's id is made unique from host, process and chance.
  Client(int domain, const std::string& name);
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // True once a daemon is there to take commands and to answer; false if none was found in time.
  bool wait_for_daemon(double timeout_s);

  // A command with this client's id, the next request id and the present stamp filled in.
  OperatorCommand command(const std::string& verb);
  // Sends it as it is; false if DDS would not take it. Texts longer than the message's bounds are
  // cut. A command that gets no answer is sent again by wait(): a daemon that is just being
  // discovered may miss the first one, and recognises the second one if it does not.
  bool send(const OperatorCommand& command);

  // Waits until an acknowledgement or a status is there, at the latest after timeout_s.
  void wait(double timeout_s);
  // The oldest acknowledgement not yet taken, to whomever; none if there is none.
  std::optional<OperatorAck> take_acknowledgement();
  // The newest of each since the last call.
  std::optional<DaemonStatus> take_status();
  std::optional<DaemonExplanation> take_explanation();
  std::optional<DaemonTuning> take_tuning();

  const std::string& id() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace wb
