// Where every agent's recurrent state lives between two decisions: a view over the arena's two buffers per
// environment. Step k reads the buffer of parity k and writes the other one, so a step that is answered twice
// (its first policy worker was killed half way) reads the same input again.
#pragma once

#include <cstdint>
#include <span>

#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// View; valid while the arena is mapped.
class RecurrentStateTable {
 public:
  explicit RecurrentStateTable(const shm::Arena& arena);

  /// Floats of one agent's state, H; 0 without a recurrent core.
  int64_t state_count() const { return state_count_; }

  /// Copies the input state [N, H] of decision `step_id` into `out`; zeros when `reset`.
  void load(int env_index, uint64_t step_id, bool reset, std::span<float> out) const;
  /// Stores the state [N, H] after decision `step_id`, the input of the next one.
  void store(int env_index, uint64_t step_id, std::span<const float> in) const;

 private:
  const shm::Arena* arena_;
  int64_t state_count_;
};

}  // namespace comrad::policy
