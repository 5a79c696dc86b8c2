#include "rollout_buffer/link/session/remote_workers.h"

#include <atomic>
#include <span>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/remote_worker_slot.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {

std::vector<int> RemoteWorkers::of(uint64_t peer_id) const {
  std::vector<int> workers;
  for (int worker = first_worker_; worker < first_worker_ + worker_count_; ++worker)
    if (arena_.remote_worker_slots().slot(worker).sender_id.load(std::memory_order_acquire) == peer_id)
      workers.push_back(worker);
  return workers;
}

std::vector<int> RemoteWorkers::take(uint64_t peer_id, int count) {
  const std::vector<int> free = of(0);
  COMRAD_CHECK(count <= static_cast<int>(free.size()), "only free places are taken");
  const int envs = arena_.shape().envs_per_worker;
  for (const int worker : std::span(free).first(static_cast<std::size_t>(count))) {
    for (int env = worker * envs; env < (worker + 1) * envs; ++env) {
      shm::RemoteEnvironment& remote = arena_.remote_worker_slots().environment(env);
      remote.steps_sealed_before = arena_.accounts().of(env).sealed.load();
      remote.has_offset = 0;
    }
    arena_.remote_worker_slots().slot(worker).sender_id.store(peer_id, std::memory_order_release);
  }
  return of(peer_id);
}

void RemoteWorkers::free(uint64_t peer_id) {
  for (const int worker : of(peer_id)) arena_.remote_worker_slots().slot(worker).sender_id = 0;
}

uint64_t RemoteWorkers::rollout_of(int env, uint64_t theirs) {
  shm::RemoteEnvironment& remote = arena_.remote_worker_slots().environment(env);
  if (remote.has_offset == 0) {
    remote.rollout_offset = ++remote.rollout_index - theirs;
    remote.has_offset = 1;
  }
  return theirs + remote.rollout_offset;
}

int64_t RemoteWorkers::ahead(int env, uint64_t rollout_index) const {
  return static_cast<int64_t>(rollout_index - arena_.remote_worker_slots().environment(env).rollout_index);
}

uint64_t RemoteWorkers::seal(int env, uint32_t slab_index, const RemoteRollout& rollout) {
  const shm::ArenaShape& shape = arena_.shape();
  shm::SlabHeader& header = arena_.slabs().header(static_cast<int>(slab_index));
  header.env_index = static_cast<uint32_t>(env);
  header.length = rollout.length;
  header.layout_id = rollout.layout_id;
  header.first_episode = rollout.first_episode;
  std::atomic_signal_fence(
      std::memory_order_release);  // as a simulator: a kill leaves no count with another's name
  header.rollout_index = rollout.rollout_index;
  // reclaim_sim_worker() takes it back if we die before the seal.
  arena_.remote_worker_slots().environment(env).rollout_index = rollout.rollout_index + 1;
  std::atomic<uint64_t>& made = arena_.accounts().of(env).made;  // here, as far as this arena is concerned
  made.store(made.load(std::memory_order_relaxed) + rollout.length, std::memory_order_release);
  arena_.slabs().seal(slab_index);
  const uint64_t decisions =
      uint64_t{rollout.length} * static_cast<uint64_t>(shape.trajectory.env.num_agents);
  arena_.sim_counters(env / shape.envs_per_worker).decisions.fetch_add(decisions, std::memory_order_relaxed);
  return decisions;
}

uint64_t RemoteWorkers::sealed_for(uint64_t peer_id) const {
  const int envs = arena_.shape().envs_per_worker;
  uint64_t steps = 0;
  for (const int worker : of(peer_id))
    for (int env = worker * envs; env < (worker + 1) * envs; ++env)
      steps += arena_.accounts().of(env).sealed.load() -
               arena_.remote_worker_slots().environment(env).steps_sealed_before;
  return steps * static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
}

}  // namespace comrad::link
