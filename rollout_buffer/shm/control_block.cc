#include "rollout_buffer/shm/control_block.h"

#include <unistd.h>

namespace comrad::shm {

void WorkerCounters::begin_life() {
  pid.store(static_cast<uint32_t>(getpid()));
  epoch.fetch_add(1);
  state.store(WorkerState::kStarting);
}

}  // namespace comrad::shm
