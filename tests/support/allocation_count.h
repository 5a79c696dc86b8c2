// Counts operator new per thread, for tests of code that must not allocate. Link allocation_count.cc.
#pragma once

#include <cstdint>

namespace comrad::test {

uint64_t allocations_of_this_thread();

}  // namespace comrad::test
