#include "rollout_buffer/shm/slab_pool.h"

#include <algorithm>
#include <utility>

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {
namespace {

constexpr uint64_t kNoRollout = UINT64_MAX;   // of a slab that was acquired a moment ago
constexpr uint64_t kNoPosition = UINT64_MAX;  // of a slab whose sealing has not begun

}  // namespace

SlabPool::SlabPool(const ArenaShape& shape, Region& region, ControlBlock* control, const Accounts& accounts)
    : shape_(shape),
      offsets_(shape.trajectory),
      control_(control),
      accounts_(accounts),
      headers_(region.take<SlabHeader>(shape.slab_count)),
      slabs_(region.take<std::byte>(shape.slab_count * offsets_.slab_bytes, kPageBytes)) {}

SlabView SlabPool::view(int slab_index) const {
  COMRAD_CHECK(slab_index >= 0 && slab_index < shape_.slab_count, "slab index is in range");
  return SlabView(offsets_, slabs_ + int64_t{slab_index} * offsets_.slab_bytes);
}

SlabHeader& SlabPool::header(int slab_index) const {
  return element(headers_, slab_index, shape_.slab_count, "slab index is in range");
}

std::optional<uint32_t> SlabPool::acquire(int sim_worker) const {
  COMRAD_CHECK(sim_worker >= 0 && sim_worker < shape_.sim_worker_count, "simulator index is in range");
  const uint32_t owner = static_cast<uint32_t>(sim_worker) + 1;
  // Every simulator starts its search elsewhere, so that they seldom fight over one cache line.
  const int32_t count = shape_.slab_count;
  const int32_t first = static_cast<int32_t>(int64_t{sim_worker} * count / shape_.sim_worker_count);
  for (int32_t offset = 0; offset < count; ++offset) {
    const int32_t index = (first + offset) % count;
    SlabHeader& found = header(index);
    uint32_t no_owner = 0;
    if (found.state.load(std::memory_order_acquire) != SlabState::kFree ||
        !found.owner.compare_exchange_strong(no_owner, owner, std::memory_order_acq_rel))
      continue;
    // The slab may have been filled and sealed between the two looks; the owner word now keeps it still.
    if (found.state.load(std::memory_order_acquire) != SlabState::kFree) {
      found.owner.store(0, std::memory_order_release);
      continue;
    }
    found.length = 0;
    found.env_index =
        static_cast<uint32_t>(sim_worker * shape_.envs_per_worker);  // names its simulator from now on
    found.rollout_index = kNoRollout;
    found.position = kNoPosition;
    found.state.store(SlabState::kFilling, std::memory_order_release);
    return static_cast<uint32_t>(index);
  }
  return std::nullopt;
}

void SlabPool::seal(uint32_t slab_index) const {
  SlabHeader& filled = header(static_cast<int>(slab_index));
  COMRAD_DCHECK(filled.state.load() == SlabState::kFilling, "only a slab that is being filled is sealed");
  EnvAccount& account = accounts_.of(static_cast<int>(filled.env_index));
  const uint64_t sealed = account.sealed.load(std::memory_order_relaxed);
  filled.position = sealed;
  std::atomic_signal_fence(std::memory_order_release);  // a kill leaves no count that cannot be taken back
  account.sealed.store(sealed + filled.length, std::memory_order_release);
  filled.seal_ticket = control_->slabs_sealed.fetch_add(1, std::memory_order_acq_rel);
  filled.owner.store(0, std::memory_order_release);
  filled.state.store(SlabState::kSealed, std::memory_order_release);
  ring(control_->slab_sealed);
}

void SlabPool::abandon(uint32_t slab_index) const {
  SlabHeader& unwanted = header(static_cast<int>(slab_index));
  COMRAD_DCHECK(unwanted.state.load() == SlabState::kFilling,
                "only a slab that is being filled is abandoned");
  unwanted.owner.store(0, std::memory_order_release);
  unwanted.state.store(SlabState::kFree, std::memory_order_release);
  ring(control_->slab_released);
}

std::vector<uint32_t> SlabPool::drain(int max_count, const EnvShare& share) const {
  // A slab sealed while we look could be seen although an older one was passed unsealed a moment ago.
  // Whatever has a ticket from before the look had all older slabs of its environment sealed by then.
  const uint64_t ticket_limit = control_->slabs_sealed.load(std::memory_order_acquire);
  std::vector<std::pair<uint64_t, uint32_t>> sealed;
  for (int index = 0; index < shape_.slab_count; ++index) {
    const SlabHeader& one = header(index);
    if (one.state.load(std::memory_order_acquire) == SlabState::kSealed && one.seal_ticket < ticket_limit &&
        share.has(one.env_index))
      sealed.emplace_back(one.seal_ticket, static_cast<uint32_t>(index));
  }
  std::sort(sealed.begin(), sealed.end());
  std::vector<uint32_t> drained;
  for (const auto& [ticket, index] : sealed) {
    if (static_cast<int>(drained.size()) >= max_count) break;
    SlabHeader& oldest = header(static_cast<int>(index));
    SlabState expected = SlabState::kSealed;
    if (oldest.state.compare_exchange_strong(expected, SlabState::kLearning, std::memory_order_acq_rel)) {
      note_taken(oldest);
      drained.push_back(index);
    }
  }
  return drained;
}

std::vector<uint32_t> SlabPool::adopt() const {
  std::vector<std::pair<uint64_t, uint32_t>> orphans;
  for (int index = 0; index < shape_.slab_count; ++index) {
    const SlabHeader& one = header(index);
    if (one.state.load(std::memory_order_acquire) != SlabState::kLearning) continue;
    note_taken(one);  // its reader may have died between the two
    orphans.emplace_back(one.seal_ticket, static_cast<uint32_t>(index));
  }
  std::sort(orphans.begin(), orphans.end());
  std::vector<uint32_t> slabs;
  for (const auto& [ticket, index] : orphans) slabs.push_back(index);
  return slabs;
}

/// An environment's slabs are drained in their order, so the end of the newest one shows how much was taken.
void SlabPool::note_taken(const SlabHeader& header) const {
  const uint32_t env_index = header.env_index;
  if (env_index >= static_cast<uint32_t>(shape_.env_count()))
    return;  // a byte in shared memory may be anything
  std::atomic<uint64_t>& taken = accounts_.of(static_cast<int>(env_index)).taken;
  const uint64_t end = header.position + header.length;
  uint64_t known = taken.load(std::memory_order_relaxed);
  while (known < end &&
         !taken.compare_exchange_weak(known, end, std::memory_order_release, std::memory_order_relaxed)) {
  }
}

void SlabPool::release(uint32_t slab_index) const {
  SlabState expected = SlabState::kLearning;
  const bool is_released =
      header(static_cast<int>(slab_index))
          .state.compare_exchange_strong(expected, SlabState::kFree, std::memory_order_acq_rel);
  COMRAD_DCHECK(is_released, "only a slab in training is released");
  if (is_released) ring(control_->slab_released);
}

int SlabPool::sealed_count() const { return counts().sealed; }

SlabCounts SlabPool::counts() const {
  SlabCounts counts;
  for (int index = 0; index < shape_.slab_count; ++index) {
    switch (header(index).state.load(std::memory_order_acquire)) {
      case SlabState::kFree:
        ++counts.free;
        break;
      case SlabState::kFilling:
        ++counts.filling;
        break;
      case SlabState::kSealed:
        ++counts.sealed;
        break;
      case SlabState::kLearning:
        ++counts.learning;
        break;
    }
  }
  return counts;
}

void SlabPool::reclaim_filling(
    int sim_worker, const std::function<void(int env_index, uint64_t rollout_index)>& play_again) const {
  const uint32_t owner = static_cast<uint32_t>(sim_worker) + 1;
  const auto envs = static_cast<uint32_t>(shape_.envs_per_worker);
  bool has_freed = false;
  for (int index = 0; index < shape_.slab_count; ++index) {
    SlabHeader& orphan = header(index);
    const bool is_owner = orphan.owner.load(std::memory_order_acquire) == owner;
    // While kFilling, env_index names the slab's environment; the owner word alone may be a dead acquirer's last
    // touch on a slab that another simulator was sealing.
    const bool is_filling = orphan.state.load(std::memory_order_acquire) == SlabState::kFilling;
    if (const uint32_t env_index = orphan.env_index;
        is_filling && env_index / envs == static_cast<uint32_t>(sim_worker)) {
      // Killed between counting the rollout and sealing it: the successor plays it again, because in lock step
      // the learner waits for every one.
      play_again(static_cast<int>(env_index), orphan.rollout_index);
      if (orphan.position != kNoPosition) {  // killed within seal()
        std::atomic<uint64_t>& sealed = accounts_.of(static_cast<int>(env_index)).sealed;
        sealed.store(std::min(sealed.load(), orphan.position));
      }
      orphan.owner.store(0, std::memory_order_release);
      orphan.state.store(SlabState::kFree, std::memory_order_release);
      has_freed = true;
    } else if (is_owner) {
      orphan.owner.store(0, std::memory_order_release);
      has_freed = true;
    }
  }
  if (has_freed) ring(control_->slab_released);
}

int SlabPool::reclaim_learning() const {
  int freed = 0;
  for (int index = 0; index < shape_.slab_count; ++index) {
    SlabHeader& orphan = header(index);
    if (orphan.state.load(std::memory_order_acquire) != SlabState::kLearning) continue;
    note_taken(orphan);  // its reader may have died between the two
    SlabState expected = SlabState::kLearning;
    freed += orphan.state.compare_exchange_strong(expected, SlabState::kFree, std::memory_order_acq_rel);
  }
  if (freed > 0) ring(control_->slab_released);
  return freed;
}

}  // namespace comrad::shm
