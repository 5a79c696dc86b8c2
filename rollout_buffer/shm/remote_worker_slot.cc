#include "rollout_buffer/shm/remote_worker_slot.h"

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {

RemoteWorkerSlots::RemoteWorkerSlots(const ArenaShape& shape, Region& region)
    : shape_(shape),
      slots_(region.take<RemoteWorkerSlot>(shape.remote_worker_count)),
      environments_(
          region.take<RemoteEnvironment>(int64_t{shape.remote_worker_count} * shape.envs_per_worker)) {}

RemoteWorkerSlot& RemoteWorkerSlots::slot(int sim_worker) const {
  return element(slots_, sim_worker - shape_.own_worker_count(), shape_.remote_worker_count,
                 "the simulator is a remote one");
}

RemoteEnvironment& RemoteWorkerSlots::environment(int env_index) const {
  return element(environments_, env_index - shape_.own_worker_count() * shape_.envs_per_worker,
                 int64_t{shape_.remote_worker_count} * shape_.envs_per_worker,
                 "the environment is a remote worker's");
}

}  // namespace comrad::shm
