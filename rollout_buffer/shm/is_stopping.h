// When the loop of a worker program ends.
#pragma once

#include <atomic>

#include "rollout_buffer/shm/arena.h"

namespace comrad::shm {

/// Whether a worker is to end: SIGTERM has raised `stop`, or the run is stopping.
inline bool is_stopping(const std::atomic<bool>& stop, const Arena& arena) {
  return stop.load(std::memory_order_relaxed) ||
         arena.control().run_state.load(std::memory_order_acquire) == RunState::kStopping;
}

}  // namespace comrad::shm
