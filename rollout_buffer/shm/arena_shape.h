// The numbers that size an arena. Its header contains them, so that every process computes the same places.
#pragma once

#include <cstdint>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"

namespace comrad::shm {

/// Everything that sizes an arena. Trivially copyable; stored in the header.
struct ArenaShape {
  TrajectoryShape trajectory;
  int32_t sim_worker_count = 1;
  int32_t envs_per_worker = 16;   ///< env_index = worker * envs_per_worker + local index
  int32_t splits_per_worker = 2;  ///< parts of a worker's environments that alternate: 1 or 2
  int32_t policy_worker_count = 1;
  int32_t slab_count = 64;
  int32_t journal_steps = 0;  ///< decisions kept per environment for exact resume; 0: no journal
  int32_t episode_ring_capacity = 4096;
  int64_t weights_bytes = 0;        ///< capacity of one weights buffer
  int32_t remote_worker_count = 0;  ///< the last of the sim workers: played by other hosts
  int32_t remote_frame_worker_count =
      0;  ///< the first of the remote workers: policy workers of this host play with them

  /// Simulators of this host.
  int32_t own_worker_count() const { return sim_worker_count - remote_worker_count; }
  bool is_remote(int sim_worker) const { return sim_worker >= own_worker_count(); }
  /// Simulators that policy workers of this host answer: the first ones.
  int32_t served_worker_count() const { return own_worker_count() + remote_frame_worker_count; }
  int32_t env_count() const { return sim_worker_count * envs_per_worker; }
  /// Environments [first, last) of one split of a worker, as local indices.
  int32_t split_begin(int32_t split) const { return envs_per_worker * split / splits_per_worker; }
  int32_t split_end(int32_t split) const { return envs_per_worker * (split + 1) / splits_per_worker; }
  /// The policy worker that serves a split: splits are dealt out in turn.
  int32_t policy_worker_of(int32_t sim_worker, int32_t split) const {
    return (sim_worker * splits_per_worker + split) % policy_worker_count;
  }
};

/// Whether every number lies in its bounds, whose products all fit 63 bits: sizes are computed without overflow checks
/// afterwards. Errors: kBadInput.
Status validate(const ArenaShape& shape);

}  // namespace comrad::shm
