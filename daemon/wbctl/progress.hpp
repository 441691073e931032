// Shows how a command fares: one line that rewrites itself on a terminal, plain lines elsewhere,
// nothing with --json.
#pragma once
#include <string>

#include "daemon/service/operator_messages.hpp"

namespace wb {

class Progress {
 public:
  explicit Progress(bool quiet);
  void show(const OperatorAck& ack, double elapsed_s);
  void finish();  // ends a line that would otherwise be rewritten

 private:
  bool quiet_;
  bool terminal_;
  bool line_open_ = false;
  std::string phase_;
  double shown_s_ = -1;
};

}  // namespace wb
