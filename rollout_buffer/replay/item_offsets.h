// The bytes of one stored trajectory: a slab without what only on-policy algorithms need, without empty
// rows and without masks that allow everything. Small fields come first, frames last. Stage: seal > drain
// > replay.
#pragma once

#include <cstdint>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/trajectory.h"

namespace comrad::replay {

/// The index entry of an item; together with the run's shape it fixes where every byte lies.
struct ItemForm {
  int32_t length = 0;                  ///< L filled steps, 1..T
  int32_t finals = 0;                  ///< F rows of true last observations, 0..K
  bool has_mask = false;               ///< some choice was forbidden somewhere; else no mask is stored
  bool has_state = false;              ///< the recurrent state before step 0 is stored
  bool compressed = false;             ///< each frame is one LZ4 block
  bool has_post_death_reward = false;  ///< there is room for rewards that are paid behind the trajectory
};

/// Byte offsets from the start of an item, a pure function of shape and form.
struct ItemOffsets {
  ItemOffsets() = default;
  ItemOffsets(const TrajectoryShape& shape, const ItemForm& form);

  int64_t recurrent_state = 0;     ///< f32 [N, H]
  int64_t measurement = 0;         ///< f32 [L+1, N, M]
  int64_t final_measurement = 0;   ///< f32 [F, N, M]
  int64_t global_state = 0;        ///< f32 [L+1, S]
  int64_t final_global_state = 0;  ///< f32 [F, S]
  int64_t reward = 0;              ///< f32 [L, N]
  int64_t post_death_reward = 0;   ///< f32 [N], see post_death_reward.h
  int64_t frame_ends = 0;    ///< u32 [(L+1+F) * N], end of each LZ4 block behind `frames`; compressed only
  int64_t action = 0;        ///< u8  [L, N, heads]
  int64_t agent_active = 0;  ///< u8  [L+1, N]
  int64_t terminated = 0;    ///< u8  [L]
  int64_t truncated = 0;     ///< u8  [L]
  int64_t valid = 0;         ///< u8  [L]
  int64_t final_row = 0;     ///< i8  [L], -1 or f
  int64_t action_mask = 0;   ///< u8  [L+1, N, A]
  int64_t frames = 0;        ///< u8  [L+1, N, C, H, W] then [F, N, C, H, W], or LZ4 blocks in that order
  int64_t frame_count = 0;   ///< (L+1+F) * N
  int64_t raw_bytes = 0;     ///< whole item with frames as they are
};

/// A slab's small fields, checked and laid out, and what belongs behind them.
struct PackedItem {
  ItemForm form;
  ItemOffsets offsets;
  std::vector<std::byte> head;      ///< offsets.frames bytes
  std::vector<int32_t> final_rows;  ///< rows of the slab's final block, in the order they are stored
  int64_t broken_decisions = 0;     ///< agent decisions whose record was unusable
};

/// Fills `item` from a slab of which `length` steps are filled (more than T counts as T; 0 gives an item of
/// length 0 that is not to be stored).
///
/// What peers wrote is not trusted (schema/slab_check.h). A decision is broken where its action lies outside its head,
/// its agent is alive and its mask allows nothing in a head, a number is not finite, or its final row is out of range; a
/// recurrent state that is not finite breaks every decision of its agent. A broken decision makes its step invalid for all agents,
/// and so does a broken observation behind the step. Numbers that were not finite become 0, actions 0, masks
/// all ones. True last observations are kept of truncated steps: nothing bootstraps from a terminated one.
/// `kept` lists what the form keeps: has_state, compressed and has_post_death_reward are read; its other fields are found.
void pack_item(const TrajectoryShape& shape, const ItemForm& kept, const SlabView& slab, uint32_t length,
               PackedItem& item);

/// Checks bytes that come from a file: flags are 0 or 1, actions lie inside their heads, final rows exist,
/// numbers are finite, LZ4 blocks are in order, the size is right. Errors: kBadFormat.
Status validate_item(const TrajectoryShape& shape, const ItemForm& form, const std::byte* bytes,
                     int64_t byte_count);

}  // namespace comrad::replay
