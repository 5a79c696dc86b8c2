// What deterministic resume needs of the environments, taken at a rollout boundary while all of them are
// parked: the journals (episode seed and the actions since reset) and the recurrent states. Goes into
// checkpoints and back into a fresh arena.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

struct JournalSnapshot {
  uint64_t next_rollout = 0;     ///< the rollout that every environment begins next
  int64_t action_bytes = 0;      ///< N * heads, bytes of one joint action
  int64_t state_floats = 0;      ///< N * H, of one parity
  std::vector<int64_t> header;   ///< [env, 5] episode_seed, episode_id, step_id, rollout_index, length
  std::vector<uint8_t> action;   ///< all environments' joint actions, one after the other
  std::vector<float> recurrent;  ///< [env, 2, N * H]

  /// Copies the arena's journals once `next_rollout` is every environment's next.
  /// Errors: kTimeout when one does not within `timeout_ms`; kUnsupported when a journal overflowed.
  static Expected<JournalSnapshot> capture(const shm::Arena& arena, uint64_t next_rollout, int timeout_ms);

  /// Section "journal" of a checkpoint.
  void save(StateDict& state) const;
  static bool is_in(const StateDict& state) { return state.has("journal/header"); }
  /// Errors: kBadFormat.
  static Expected<JournalSnapshot> load(const StateDict& state);

  /// Writes the journals into a fresh arena, marked for replay, and the recurrent states.
  /// Errors: kBadFormat when the number of environments, agents or heads differs from the arena's.
  Status restore(const shm::Arena& arena) const;
};

}  // namespace comrad::learn
