#include "rollout_buffer/shm/futex.h"

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <ctime>

#include "rollout_buffer/core/clock.h"

namespace comrad::shm {
namespace {

// The futex system calls work on the word's address; the FUTEX_PRIVATE_FLAG stays off, because peers
// are processes.
uint32_t* word_of(std::atomic<uint32_t>& atomic) { return reinterpret_cast<uint32_t*>(&atomic); }
static_assert(sizeof(std::atomic<uint32_t>) == sizeof(uint32_t) &&
              std::atomic<uint32_t>::is_always_lock_free);

}  // namespace

void ring(Doorbell& doorbell) {
  // Sequentially consistent on both words: either the ringer sees the sleeper, or the sleeper sees the ring.
  doorbell.rings.fetch_add(1, std::memory_order_seq_cst);
  if (doorbell.sleepers.load(std::memory_order_seq_cst) != 0)
    syscall(SYS_futex, word_of(doorbell.rings), FUTEX_WAKE, INT_MAX, nullptr, nullptr, 0);
}

uint32_t listen(const Doorbell& doorbell) { return doorbell.rings.load(std::memory_order_seq_cst); }

bool wait(Doorbell& doorbell, uint32_t heard, int64_t timeout_us) {
  if (listen(doorbell) != heard) return true;
  if (timeout_us <= 0) return false;
  const int64_t deadline_ns = monotonic_ns() + timeout_us * 1000;
  doorbell.sleepers.fetch_add(1, std::memory_order_seq_cst);
  bool rang = false;
  for (;;) {
    rang = listen(doorbell) != heard;
    const int64_t left_ns = deadline_ns - monotonic_ns();
    if (rang || left_ns <= 0) break;
    const timespec left{left_ns / 1'000'000'000, left_ns % 1'000'000'000};
    const long result = syscall(SYS_futex, word_of(doorbell.rings), FUTEX_WAIT, heard, &left, nullptr, 0);
    // A signal ends the wait early, so that the caller looks at its stop flag.
    if (result == -1 && errno == EINTR) {
      rang = listen(doorbell) != heard;
      break;
    }
  }
  doorbell.sleepers.fetch_sub(1, std::memory_order_seq_cst);
  return rang;
}

}  // namespace comrad::shm
