#pragma once
#include "drivers/driver.h"
#include "tests/fuzz/dds_bytes.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace wb::dds {

bool within_limits(const wb_commands& out, const wb_description& robot);

// One input is a series of messages to one low-level computer. taken: commands that reach drives.
fuzz::Tally session(Bytes& bytes);

}  // namespace wb::dds
