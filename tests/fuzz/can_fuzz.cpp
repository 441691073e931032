// libFuzzer: build/fuzz/tests/fuzz/can_fuzz -max_total_time=60
#include "tests/fuzz/can_fuzz.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)wb::can::fuzz_one(data, size);
  return 0;
}
