// The trajectory slab: T steps of all N agents of one environment, the unit that everything moves by index.
// The simulator renders into it, the policy worker reads and answers in it, the learner trains from it.
#pragma once

#include <cstdint>
#include <span>

#include "rollout_buffer/schema/spec.h"

namespace comrad {

/// Byte offsets of every field from the start of a slab. A pure function of the shape, so that every process
/// computes the same ones; each field starts on a cache line.
struct SlabOffsets {
  explicit SlabOffsets(const TrajectoryShape& shape);

  TrajectoryShape shape;
  int64_t frame = 0;               ///< u8  [T+1, N, C, H, W]   simulator
  int64_t measurement = 0;         ///< f32 [T+1, N, M]         simulator
  int64_t global_state = 0;        ///< f32 [T+1, S]            simulator; of the world (env/global_state.h)
  int64_t action_mask = 0;         ///< u8  [T+1, N, A]         simulator; ones where there is no mask
  int64_t agent_active = 0;        ///< u8  [T+1, N]            simulator; 0 while dead without respawn
  int64_t reward = 0;              ///< f32 [T, N]              simulator
  int64_t terminated = 0;          ///< u8  [T]                 simulator
  int64_t truncated = 0;           ///< u8  [T]                 simulator
  int64_t final_index = 0;         ///< i32 [T], -1 or k        simulator
  int64_t final_frame = 0;         ///< u8  [K, N, C, H, W]     simulator
  int64_t final_measurement = 0;   ///< f32 [K, N, M]           simulator
  int64_t final_global_state = 0;  ///< f32 [K, S]            simulator
  int64_t layout_index = 0;        ///< i32 [T], in the run's pool   simulator
  int64_t recurrent_state = 0;     ///< f32 [S, N, H]           policy worker
  int64_t action = 0;              ///< i32 [T, N, heads]       policy worker
  int64_t log_prob = 0;            ///< f32 [T, N]              policy worker
  int64_t value = 0;               ///< f32 [T+1, N]            policy worker
  int64_t final_value = 0;         ///< f32 [K, N]              policy worker
  int64_t logits = 0;              ///< f32 [T, N, A]           policy worker
  int64_t policy_version = 0;      ///< u32 [T, N]              policy worker
  int64_t valid = 0;               ///< u8  [T]                 simulator on sealing, learner for lag
  int64_t slab_bytes = 0;          ///< whole slab, rounded up to a page
};

/// One episode's identity inside a slab.
struct EpisodeStamp {
  uint64_t episode_id = 0;    ///< counts up per environment, never reused inside a run
  uint64_t episode_seed = 0;  ///< replays the episode
};

/// Typed access to one slab's fields. A view: it owns nothing and is valid while the arena is mapped.
class SlabView {
 public:
  SlabView(const SlabOffsets& offsets, std::byte* base) : offsets_(&offsets), base_(base) {}

  const TrajectoryShape& shape() const { return offsets_->shape; }

  std::span<uint8_t> frame(int step, int agent) const;        ///< [C*H*W]
  std::span<uint8_t> frames(int step) const;                  ///< [N*C*H*W]
  std::span<float> measurement(int step, int agent) const;    ///< [M]
  std::span<float> global_state(int step) const;              ///< [S]
  std::span<uint8_t> action_mask(int step, int agent) const;  ///< [A]
  uint8_t& agent_active(int step, int agent) const;
  float& reward(int step, int agent) const;
  uint8_t& terminated(int step) const;
  uint8_t& truncated(int step) const;
  int32_t& final_index(int step) const;
  int32_t& layout_index(int step) const;
  std::span<uint8_t> final_frame(int row, int agent) const;         ///< [C*H*W]
  std::span<float> final_measurement(int row, int agent) const;     ///< [M]
  std::span<float> final_global_state(int row) const;               ///< [S]
  std::span<float> recurrent_state(int snapshot, int agent) const;  ///< [H]
  std::span<int32_t> action(int step, int agent) const;             ///< [heads]
  float& log_prob(int step, int agent) const;
  float& value(int step, int agent) const;
  float& final_value(int row, int agent) const;
  std::span<float> logits(int step, int agent) const;  ///< [A]
  uint32_t& policy_version(int step, int agent) const;
  uint8_t& valid(int step) const;

  /// Before the first row: what a writer sets only where something happened (rewards, ends, valid) is reset to none.
  void clear() const;
  /// After the last one: the rows beyond `length` repeat it. They still held an older rollout's bytes; so the slab's content is
  /// a function of this rollout alone, whatever a reader does with rows that are not valid.
  void pad(int length) const;

  template <typename T>
  T* at(int64_t offset_bytes) const {
    return reinterpret_cast<T*>(base_ + offset_bytes);
  }
  const SlabOffsets& offsets() const { return *offsets_; }

 private:
  const SlabOffsets* offsets_;
  std::byte* base_;
};

}  // namespace comrad
