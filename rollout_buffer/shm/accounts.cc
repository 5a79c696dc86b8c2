#include "rollout_buffer/shm/accounts.h"

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {

Accounts::Accounts(const ArenaShape& shape, Region& region)
    : shape_(shape), accounts_(region.take<EnvAccount>(shape.env_count())) {}

EnvAccount& Accounts::of(int env_index) const {
  return element(accounts_, env_index, shape_.env_count(), "environment index is in range");
}

DecisionCounts Accounts::counts() const {
  DecisionCounts counts;
  for (int env = 0; env < shape_.env_count(); ++env) {
    const EnvAccount& account = of(env);
    // In this order: each of them only grows, and what comes later in it is counted earlier.
    counts.taken += account.taken.load(std::memory_order_acquire);
    counts.lost += account.lost.load(std::memory_order_acquire);
    counts.sealed += account.sealed.load(std::memory_order_acquire);
    counts.made += account.made.load(std::memory_order_acquire);
  }
  const auto agents = static_cast<uint64_t>(shape_.trajectory.env.num_agents);
  for (uint64_t* count : {&counts.made, &counts.sealed, &counts.taken, &counts.lost}) *count *= agents;
  return counts;
}

uint64_t Accounts::write_off(int sim_worker) const {
  uint64_t steps_lost = 0;
  for (int local = 0; local < shape_.envs_per_worker; ++local) {
    EnvAccount& account = of(sim_worker * shape_.envs_per_worker + local);
    if (shape_.is_remote(sim_worker)) {
      account.made.store(account.sealed.load() + account.lost.load());
      continue;
    }
    const uint64_t lost = account.made.load() - account.sealed.load();
    steps_lost += lost - account.lost.exchange(lost);
  }
  return steps_lost * static_cast<uint64_t>(shape_.trajectory.env.num_agents);
}

}  // namespace comrad::shm
