// libFuzzer's entry; built with -DWB_FUZZ=ON by clang (CMakeLists.txt here).
#include "tests/fuzz/dds_fuzz.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  (void)wb::dds::fuzz_one(data, size);
  return 0;
}
