#include "rollout_buffer/link/delivery_account.h"

#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::link {

std::vector<uint32_t> DeliveryAccount::begin_life() {
  delivered_ = arena_.learner_counters().decisions.load();
  lost_ = arena_.control().decisions_lost_on_the_way.load();
  arena_.control().learner_decisions_before = delivered_;
  std::vector<uint32_t> slabs = arena_.slabs().adopt();
  uint64_t held = 0;
  for (const uint32_t slab : slabs) held += decisions_of(slab);
  // A predecessor that died between counting its oldest one and giving it back has counted more than was taken.
  if (!slabs.empty() && delivered_ + lost_ + held > arena_.accounts().counts().taken) {
    arena_.slabs().release(slabs.front());
    slabs.erase(slabs.begin());
  }
  return slabs;
}

void DeliveryAccount::finish(uint32_t slab, bool is_delivered) {
  (is_delivered ? delivered_ : lost_) += decisions_of(slab);
  if (is_delivered) {
    arena_.learner_counters().decisions = delivered_;
    arena_.learner_counters().batches.fetch_add(1);
  } else {
    arena_.control().decisions_lost_on_the_way = lost_;
  }
  arena_.slabs().release(slab);
}

uint64_t DeliveryAccount::decisions_of(uint32_t slab) const {
  return uint64_t{arena_.slabs().header(static_cast<int>(slab)).length} *
         static_cast<uint64_t>(arena_.shape().trajectory.env.num_agents);
}

FeederAccount account_of(const shm::Arena& arena, const DeliveryAccount& deliveries) {
  FeederAccount account{.delivered = deliveries.delivered(), .lost = deliveries.lost()};
  for (int sim = 0; sim < arena.shape().sim_worker_count; ++sim)
    account.played += arena.sim_counters(sim).decisions.load();
  const auto agents = static_cast<uint64_t>(arena.shape().trajectory.env.num_agents);
  for (int index = 0; index < arena.shape().slab_count; ++index) {
    const shm::SlabHeader& header = arena.slabs().header(index);
    const shm::SlabState state = header.state.load(std::memory_order_acquire);
    if (state == shm::SlabState::kSealed || state == shm::SlabState::kLearning)
      account.waiting += header.length * agents;
    else if (state == shm::SlabState::kFilling)
      account.unfinished += header.length * agents;
  }
  return account;
}

}  // namespace comrad::link
