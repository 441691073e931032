// libFuzzer's entry of every target; built with -DWB_FUZZ=ON by clang. Beside libFuzzer's flags:
//   --seeds=FOLDER    writes a corpus of seeded inputs and ends
//   --records=COUNT   ends with a line of figures once so many records were fed
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <string>

#include "tests/fuzz/fuzz.hpp"

namespace {

constexpr int kSeeds = 200;
std::uint64_t wanted = 0;  // 0: libFuzzer's own flags end the run
wb::fuzz::Tally total;

const char* value_of(const char* argument, const char* flag) {
  const std::size_t n = std::strlen(flag);
  return std::strncmp(argument, flag, n) == 0 ? argument + n : nullptr;
}

void write_seeds(const std::string& folder) {
  std::mt19937_64 random(402);
  for (int i = 0; i < kSeeds; ++i) {
    const std::vector<std::uint8_t> input = wb::fuzz::seeded(random);
    std::ofstream out(folder + "/seeded_" + std::to_string(i), std::ios::binary);
    out.write(reinterpret_cast<const char*>(input.data()),
              static_cast<std::streamsize>(input.size()));
    if (!out.flush()) {
      std::fprintf(stderr, "cannot write to %s\n", folder.c_str());
      std::exit(2);
    }
  }
}

}  // namespace

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  for (int i = 1; i < *argc; ++i) {
    if (const char* folder = value_of((*argv)[i], "--seeds=")) {
      write_seeds(folder);
      std::exit(0);
    }
    if (const char* count = value_of((*argv)[i], "--records="))
      wanted = std::strtoull(count, nullptr, 10);
  }
  return 0;
}

// Half of the inputs are libFuzzer's mutations; in the others a stretch is new, so that the records
// of a long input do not stay those of its parent.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned seed) {
  std::mt19937_64 random(seed);
  if (random() % 2 == 0 || size == 0) return LLVMFuzzerMutate(data, size, max_size);
  const std::vector<std::uint8_t> fresh = wb::fuzz::seeded(random);
  const std::size_t end = std::min(fresh.size(), max_size), from = random() % std::min(size, end);
  std::memcpy(data + from, fresh.data() + from, end - from);
  return std::max(size, end);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const wb::fuzz::Tally tally = wb::fuzz::run_one(data, size);
  total.records += tally.records;
  total.taken += tally.taken;
  if (wanted == 0 || total.records < wanted) return 0;
  std::printf("%s_fuzz: %llu %s, %llu %s, no finding\n", wb::fuzz::kName,
              static_cast<unsigned long long>(total.records), wb::fuzz::kRecords,
              static_cast<unsigned long long>(total.taken), wb::fuzz::kTaken);
  std::fflush(stdout);
  _exit(0);  // libFuzzer takes exit() for a crash
}
