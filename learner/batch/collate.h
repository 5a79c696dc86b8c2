// From sealed trajectory slabs to the tensors of one training batch. Each frame is copied once, slab to
// batch, or on a GPU that policy workers share from where it went up, and the slab is free again before the first gradient is
// computed. Stage: drain > sample > minibatch.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <vector>

#include "policy_workers/device/queue.h"
#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::learn {

using torch::Tensor;

/// What on-policy algorithms learn from before they draw their minibatches, the rows of one optimizer step: T steps and
/// R rows. (ReplayBatch is the off-policy one.) A row is the trajectory of one agent; the N agents of one world
/// are neighbours: row = slab position * N + agent. Steps behind the end of a slab that was sealed early are
/// padding: invalid, terminated, action 0, zero frame.
struct RolloutBatch {
  TrajectoryShape shape;
  int64_t slab_count = 0;   ///< worlds; R = slab_count * N
  int64_t transitions = 0;  ///< agent decisions that were taken, valid or not; without padding
  bool has_action_mask = false;

  Tensor frame;            ///< u8  [T, R, C, H, W]; undefined where frames go to `frame_there` alone
  Tensor measurement;      ///< f32 [T, R, M], undefined when M = 0
  Tensor global_state;     ///< f32 [T, slab_count, S] of the worlds, undefined when S = 0
  Tensor action_mask;      ///< u8  [T, R, A]; read only when has_action_mask
  Tensor agent_active;     ///< u8  [T, R]
  Tensor action;           ///< i64 [T, R, heads]
  Tensor log_prob;         ///< f32 [T, R]     of the behaviour policy
  Tensor logits;           ///< f32 [T, R, A]  of the behaviour policy
  Tensor value;            ///< f32 [T+1, R]   as the behaviour policy predicted it (normalised units)
  Tensor final_value;      ///< f32 [T, R]     of the true last observation where an episode was cut, else 0
  Tensor reward;           ///< f32 [T, R]
  Tensor terminated;       ///< u8  [T, R]
  Tensor truncated;        ///< u8  [T, R]
  Tensor policy_version;   ///< i64 [T, R]
  Tensor layout_index;     ///< i32 [T, R]     in the run's pool; 0 where there is none
  Tensor recurrent_state;  ///< f32 [R, H] before step 0
  Tensor filled;           ///< u8  [T, R]     a decision was taken here; 0 is padding
  Tensor valid;            ///< u8  [T, R]     may be learned from; cleared further by apply_lag_filter
  Tensor value_valid;      ///< u8  [T+1, R]   made by apply_lag_filter
  Tensor reset;            ///< u8  [T, R]     state is zeroed before this step; made by apply_lag_filter

  Tensor frame_there;  ///< `frame` on the learner's device, where send_ahead() or collate_slabs() put it
  device::Event frame_arrived;
  bool is_frame_there = false;
  device::Event was_read;  ///< made by hand_back()

  Tensor advantage;      ///< f32 [T, R]  made by the algorithm, which may standardise and weigh it
  Tensor raw_advantage;  ///< f32 [T, R]  in units of the rewards; made by the algorithm, then left alone
  Tensor target;         ///< f32 [T, R]  what the critic should predict; made by the algorithm

  /// `valid` and acting() on the host, for counts that nothing waits for; made by to_device(), else undefined.
  Tensor host_valid, host_acting;  ///< u8  [T, R]

  int64_t steps() const { return shape.rollout_steps; }
  int64_t rows() const { return slab_count * shape.env.num_agents; }
  /// u8 [T, R]: decisions that a policy can learn from, valid ones of an agent that was alive. What a dead
  /// agent "does" changes nothing; what it sees and is paid still counts in values (`valid`).
  Tensor acting() const;
  /// The action mask, or an undefined tensor when everything was allowed.
  Tensor mask_or_undefined() const { return has_action_mask ? action_mask : Tensor(); }
};

/// Allocates a batch for `slab_count` slabs; reuse it, a fresh one costs a page fault per 4 KB. Its frames lie where `device` can
/// copy them while the host continues, or on `device` alone.
RolloutBatch make_rollout_batch(const TrajectoryShape& shape, int64_t slab_count,
                                torch::Device device = torch::kCPU, bool frames_there_alone = false);

/// Begins to copy a full batch's frames to a GPU, beside its work. Threads: the batcher's.
void send_ahead(RolloutBatch& batch, torch::Device device);
/// u8 [T, R, C, H, W]: the batch's frames on `device`, sent ahead or now.
Tensor frames_on(const RolloutBatch& batch, torch::Device device);

/// What `device` was given so far may read the batch later than its learner returns from the update. Threads: the learner's.
void hand_back(RolloutBatch& batch, torch::Device device);
/// Forgets the slabs collated so far, once the device has read them; the tensors stay allocated. Call before the first collate_slab
/// of a batch.
void clear(RolloutBatch& batch);

/// Copies one sealed slab into place `position`. `length` rows are filled (more than T counts as T).
/// What a peer wrote is not trusted (schema/slab_check.h): a step with an action outside its head, a non-finite number or a final
/// row out of range becomes invalid, for all agents where the number is of the global state, and a non-finite recurrent
/// state invalidates its trajectory. Returns the agent decisions that were found broken.
int64_t collate_slab(RolloutBatch& batch, int64_t position, const SlabView& slab, uint32_t length);

/// Policy lag over the taken decisions of a batch.
struct LagStats {
  double mean = 0;
  int64_t min = 0;
  int64_t max = 0;
  int64_t dropped = 0;        ///< decisions masked because of their age
  double valid_fraction = 0;  ///< of T * R
};

/// Masks decisions whose lag `learner_version - policy_version` is `max_policy_lag` or more, then derives
/// value_valid (the row behind the last filled one repeats its validity) and reset (after the end of an
/// episode and after an invalid step). A version from the future, left by a learner that died, counts as
/// lag 0.
LagStats apply_lag_filter(RolloutBatch& batch, PolicyVersion learner_version, int64_t max_policy_lag);

/// What losses need of a batch whose targets are made, on `device`; on a CPU the same tensors. The rest stays where it is.
RolloutBatch to_device(const RolloutBatch& batch, torch::Device device);

/// Calls `visit` with each field that to_device() moves and that is there, in the same order for equal shapes.
void visit_device_fields(RolloutBatch& batch, const std::function<void(Tensor&)>& visit);

/// The rows `[begin, begin + count)` of a batch, as views. Whole worlds: both numbers are multiples of N.
RolloutBatch narrow_rows(const RolloutBatch& batch, int64_t begin, int64_t count);
/// The rows of one agent of every world, as views: a batch of N = 1.
RolloutBatch agent_rows(const RolloutBatch& batch, int64_t agent);
/// The worlds at `slab_index` (i64, positions) of a batch, copied, in that order.
RolloutBatch select_slabs(const RolloutBatch& batch, const std::vector<int64_t>& slab_index);

}  // namespace comrad::learn
