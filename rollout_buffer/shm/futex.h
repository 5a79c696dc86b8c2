// Doorbells between processes: a counter in shared memory that one side rings and others wait on with a
// time-out. The state words are the truth; a doorbell only means "look again", so a lost or doubled ring does
// no harm.
#pragma once

#include <atomic>
#include <cstdint>

namespace comrad::shm {

/// Counter plus number of sleepers, on its own cache line. Zero-initialised memory is a valid doorbell.
struct alignas(64) Doorbell {
  std::atomic<uint32_t> rings;
  std::atomic<uint32_t> sleepers;
};

/// Rings: every waiter that read an older count wakes. Costs no system call without waiters.
void ring(Doorbell& doorbell);

/// The count to hand to wait(); read it before looking at the state that the doorbell announces.
uint32_t listen(const Doorbell& doorbell);

/// Sleeps until the count differs from `heard` or `timeout_us` have passed. True if it rang.
bool wait(Doorbell& doorbell, uint32_t heard, int64_t timeout_us);

}  // namespace comrad::shm
