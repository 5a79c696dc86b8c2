// The trajectory slabs: simulators fill free ones and seal them, the learner drains and releases them.
//
//   SlabHeader [slab] | slab [slab], each laid out by SlabOffsets (schema/trajectory.h)
//
// Writers: the simulator that holds the slab while kFilling, the policy worker in the rows it is asked about, the learner
// while kLearning. There are no lists that a peer killed half way could leave broken.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/arena_shape.h"
#include "rollout_buffer/shm/control_block.h"

namespace comrad::shm {

/// Life of a trajectory slab.
///
///   kFree -acquire-> kFilling -seal-> kSealed -drain-> kLearning -release-> kFree
///          (sim)              (sim)           (learner)          (learner)
enum class SlabState : uint32_t { kFree, kFilling, kSealed, kLearning };

struct alignas(kCacheLineBytes) SlabHeader {
  uint32_t env_index;
  uint32_t length;         ///< rows filled: T, or fewer where K episode ends sealed it early
  uint64_t rollout_index;  ///< counts slabs of this environment from 0
  uint64_t seal_ticket;    ///< order of sealing over all environments
  uint64_t layout_id;
  EpisodeStamp first_episode;
  uint64_t position;  ///< steps of this environment in slabs that were sealed before; see EnvAccount
  /// A slab is free when `state` is kFree and `owner` is 0. The owner word is the lock that acquiring takes;
  /// it is given back just before the state moves on. While kFilling, env_index names the slab's environment, so a
  /// simulator killed between any two of these stores loses nothing.
  alignas(kCacheLineBytes) std::atomic<SlabState> state;
  std::atomic<uint32_t> owner;  ///< sim worker index + 1 while kFilling, else 0
};
static_assert(sizeof(SlabHeader) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// Whose slabs a reader takes, where several readers share them out: those of some environments. Environments come in
/// blocks of `block`, a multiple of `count`; of each block the first ones are reader 0's, the next ones reader 1's.
struct EnvShare {
  int rank = 0, count = 1;  ///< of the readers
  int block = 1;

  bool has(uint32_t env_index) const {
    return count == 1 || static_cast<int>(env_index) % block / (block / count) == rank;
  }
  /// Of an environment of this share: how many of the share come before it.
  int place_of(uint32_t env_index) const {
    const int env = static_cast<int>(env_index), of_block = block / count;
    return count == 1 ? env : env / block * of_block + env % block % of_block;
  }
};

/// How many slabs are in which state.
struct SlabCounts {
  int free = 0;
  int filling = 0;
  int sealed = 0;
  int learning = 0;
};

class SlabPool {
 public:
  /// The other rooms outlive it: sealing takes tickets and rings there, and counts in the accounts.
  SlabPool(const ArenaShape& shape, Region& region, ControlBlock* control, const Accounts& accounts);

  const SlabOffsets& offsets() const { return offsets_; }
  SlabView view(int slab_index) const;
  SlabHeader& header(int slab_index) const;
  /// A free slab for `sim_worker`, or nothing (back-pressure). kFree -> kFilling by compare-and-swap.
  std::optional<uint32_t> acquire(int sim_worker) const;
  void seal(uint32_t slab_index) const;     ///< kFilling -> kSealed, takes a ticket, rings
  void abandon(uint32_t slab_index) const;  ///< kFilling -> kFree, rings: its owner needs it no more
  /// Takes up to `max_count` sealed slabs of a share in ticket order: kSealed -> kLearning. An environment's slabs
  /// never overtake each other. Several readers may take from one share.
  std::vector<uint32_t> drain(int max_count, const EnvShare& share = {}) const;
  /// What a dead reader had drained and not released, in order of sealing; it is counted as taken.
  std::vector<uint32_t> adopt() const;
  void release(uint32_t slab_index) const;  ///< kLearning -> kFree, rings
  int sealed_count() const;
  SlabCounts counts() const;

  /// Supervisor: frees the slabs that a dead simulator was filling. `play_again` hears of each one's rollout first.
  void reclaim_filling(int sim_worker,
                       const std::function<void(int env_index, uint64_t rollout_index)>& play_again) const;
  /// Supervisor: frees the slabs of a dead learner. Returns how many.
  int reclaim_learning() const;

 private:
  void note_taken(const SlabHeader& header) const;

  const ArenaShape shape_;
  const SlabOffsets offsets_;
  ControlBlock* const control_;
  const Accounts& accounts_;
  SlabHeader* const headers_;
  std::byte* const slabs_;
};

}  // namespace comrad::shm
