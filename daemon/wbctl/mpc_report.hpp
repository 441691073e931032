// How wbctl shows the MPC: explanations and weights, as text and as JSON. World: one ordinary
// thread.
#pragma once
#include <string>

#include "daemon/json.hpp"
#include "daemon/service/operator_messages.hpp"

namespace wb {

Json to_json(const DaemonExplanation& explanation);
std::string to_text(const DaemonExplanation& explanation);

// `only`: this weight alone; empty: all.
Json to_json(const DaemonTuning& tuning, const std::string& only);
std::string to_text(const DaemonTuning& tuning, const std::string& only);

}  // namespace wb
