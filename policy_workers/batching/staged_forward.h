// A policy worker's forward pass on a device with its own memory: the batch is packed into pinned memory and goes up in
// one copy, or, of a thread of the learner, the device reads the frames from the arena (slab_frames.h); the answers come down in
// one, and recurrent states stay where they are computed. Batches are rounded up to a few sizes, so that the work of each can be
// recorded once. Stage: forward.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "policy_workers/batching/batcher.h"
#include "policy_workers/batching/slab_frames.h"
#include "policy_workers/device/part_pool.h"
#include "policy_workers/device/queue.h"
#include "policy_workers/kernels/precision.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// Worlds that a batch of `worlds` is rounded up to: 1, 2, 3, 4, 6, 8, 12, 16, 24, ... At most half of them are idle.
int64_t bucket_of(int64_t worlds);

/// The network of one policy worker on its device; on a CPU, where tests use it, the same steps are done at once.
///
/// The state after a decision is kept on the device, and written down into the arena as well (2 KB a row beside the
/// 27 KB of its frame): the successor of a worker that is killed reads it there, as it does without a GPU. A state that is not
/// on the device, at the start or after another process answered, comes up from the batch.
///
/// Threads: the policy worker's.
class StagedForward {
 public:
  /// `packing_threads` copy frames into pinned memory, the caller's among them. With `frames`, which outlives it, none are copied, and
  /// batches are of its arena.
  StagedForward(const ActorCritic& policy, const shm::ArenaShape& shape, int packing_threads = 1,
                SlabFrames* frames = nullptr);

  /// What policy.step_rows() returns for the batch, to rounding. The output is valid until the next call. `clock` counts the packing.
  PolicyOutput step(const Batch& batch, StageClock* clock = nullptr);

  int64_t states_brought_up() const {
    return states_brought_up_;
  }  ///< rows whose state was not on the device

 private:
  /// Where a batch of one size lies: frames, measurements and indices in one piece.
  struct Bucket {
    int64_t worlds = 0;
    Tensor staging, there;  ///< u8 [bytes], on the host and on the device
    Tensor frame,
        measurement;  ///< views of `there`: u8 [B, C, H, W], f32 [B, M]; the frame is undefined with SlabFrames
    Tensor from, to;              ///< views of `there`: i64 [B], SlabFrames::Place; undefined without
    Tensor global_state;          ///< view of `there`: f32 [worlds, S]; undefined when S = 0
    Tensor read, write;           ///< views of `there`: i64 [B], rows of states_
    Tensor answer_there, answer;  ///< f32 [B, A + 1 + H]: logits, value, state
    device::Graph graph;
  };
  Bucket& bucket_for(int64_t worlds);
  void forward(Bucket& bucket);
  void bring_up(const Batch& batch);
  void pack(const Batch& batch, Bucket& bucket);
  void pack_frames(const Batch& batch, uint8_t* to);

  const ActorCritic policy_;
  const EnvShape env_;
  const int64_t state_count_, zero_row_, idle_row_;
  SlabFrames* const frames_;  ///< null: they are packed
  Tensor states_;  ///< f32 [E * N + 2, H] on the device: inputs of the environments' next decisions
  std::vector<std::optional<uint64_t>> held_;  ///< [E] the decision whose input states_ holds
  KeptFactors factors_;                        ///< that the buckets' graphs read
  std::vector<Bucket> buckets_;
  device::PartPool packers_;
  int64_t states_brought_up_ = 0;
};

}  // namespace comrad::policy
