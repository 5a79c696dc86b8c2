// One step slot for each environment: its decision goes out as an observation and comes back as an action.
//
//   StepSlot [env] | doorbells of policy workers | doorbells, SplitRound [sim worker, split] |
//   live recurrent states [env, parity, N, H]
//
// Writers: the simulator before commit, the policy worker before scatter; the state word shows whose turn it is.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>

#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"
#include "rollout_buffer/shm/futex.h"

namespace comrad::shm {

struct Region;

/// What a simulator requests from the policy worker in one hand-over.
enum class RequestKind : uint32_t {
  kAct,    ///< row `step` of the slab: choose an action, advance the recurrent state, write value
  kValue,  ///< row `step` == T of a full slab: write value[T] only; the recurrent state stays
  kFinal,  ///< row `final_row` of the finals: write final_value only; the recurrent state stays
};

/// Hand-over of one environment's decision (all N agents): observation out, action back.
///
///   kIdle -commit-> kReady -gather-> kInBatch -scatter-> kActed -take-> kIdle
///         (sim)            (policy)            (policy)         (sim)
///
/// A policy worker that dies leaves slots in kInBatch; its successor gathers kReady and kInBatch slots of the
/// same splits at start-up and answers them again, which is harmless: the recurrent state is read from one
/// parity of `recurrent` and written to the other, and the simulator reads the answer only in kActed.
enum class SlotState : uint32_t { kIdle, kReady, kInBatch, kActed };

struct alignas(kCacheLineBytes) StepSlot {
  // Simulator writes before commit.
  uint64_t step_id;     ///< decisions since the run began in this environment; parity picks the state buffer
  uint64_t episode_id;  ///< keys the action draw together with episode_step, so that an episode replays
  uint32_t episode_step;  ///< decisions since reset
  uint32_t slab_index;
  uint32_t step;       ///< row t in the slab
  uint32_t final_row;  ///< for kFinal
  RequestKind kind;
  uint32_t reset_state;  ///< 1: the recurrent input is zero (first decision of an episode)
  // Handshake: release on every store, acquire on every load.
  alignas(kCacheLineBytes) std::atomic<SlotState> state;
};
static_assert(std::atomic<SlotState>::is_always_lock_free);
static_assert(sizeof(StepSlot) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// Moves a slot along one arrow of the picture above; false (and no change) if it is not in state `from`,
/// which happens when the supervisor gave a dead peer's slot back in the meantime.
inline bool advance(StepSlot& slot, SlotState from, SlotState to) {
  return slot.state.compare_exchange_strong(from, to, std::memory_order_acq_rel, std::memory_order_acquire);
}

/// What a split of environments requests in its present round. The simulator stores it before it commits the
/// round's first slot, and no slot of an older round is outstanding then; so a policy worker that counts
/// `request_count` slots of the split in kReady holds the whole round (deterministic mode).
struct alignas(kCacheLineBytes) SplitRound {
  std::atomic<uint32_t> request_count;  ///< slots that this round commits
};
static_assert(sizeof(SplitRound) == kCacheLineBytes, "changing this bumps kArenaVersion");

class StepSlots {
 public:
  StepSlots(const ArenaShape& shape, Region& region);

  StepSlot& slot(int env_index) const;
  /// Live recurrent state [N, H] of an environment; `parity` = step_id & 1 is the input, the other
  /// the output.
  std::span<float> recurrent(int env_index, uint64_t parity) const;
  Doorbell& ready(int policy_worker) const;            ///< rung after a split committed
  Doorbell& acted(int sim_worker, int split) const;    ///< rung after a batch was scattered
  SplitRound& round(int sim_worker, int split) const;  ///< requests of the split's present round

  /// Supervisor: idles a dead simulator's slots, but for those that a policy worker has in its batch: it still writes into
  /// their slabs. Whether there are none.
  bool withdraw(int sim_worker) const;
  /// Supervisor: idles all slots and rounds of a dead simulator.
  void idle(int sim_worker) const;
  /// Supervisor: slots that a dead policy worker had in its batch become kReady again. Returns how many.
  int requeue(int policy_worker) const;

 private:
  int64_t split_count() const { return int64_t{shape_.sim_worker_count} * shape_.splits_per_worker; }

  const ArenaShape shape_;
  StepSlot* const slots_;
  Doorbell* const ready_;
  Doorbell* const acted_;
  SplitRound* const rounds_;
  const int64_t state_stride_;  // floats from one state to the next
  float* const states_;
};

}  // namespace comrad::shm
