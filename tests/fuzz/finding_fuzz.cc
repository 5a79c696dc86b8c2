// Fails on its seed, so that finding_test.sh sees what a finding does to run.sh.
#include <cstdint>

#include "tests/fuzz/play.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, std::size_t size) {
  comrad::fuzz::require(size == 0 || data[0] != '!');
  return 0;
}
