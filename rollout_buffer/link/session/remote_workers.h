// The arena's remote worker slots that one receiver serves: which host plays in which, and sealing what it has played. All
// of it lies in the arena, so that a receiver which takes over from a dead one resumes there. Stage: seal.
#pragma once

#include <cstdint>
#include <vector>

#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::link {

/// A whole trajectory of another host, as its simulator has sealed it there.
struct RemoteRollout {
  uint64_t rollout_index = 0;  ///< in this arena where it is sealed: RemoteWorkers::rollout_of()
  uint32_t length = 0;
  uint64_t layout_id = 0;
  EpisodeStamp first_episode;
};

/// Threads: one.
class RemoteWorkers {
 public:
  /// Simulators [first_worker, first_worker + worker_count) of the arena are played by other hosts.
  RemoteWorkers(const shm::Arena& arena, int first_worker, int worker_count)
      : arena_(arena), first_worker_(first_worker), worker_count_(worker_count) {}

  int count() const { return worker_count_; }
  int free_count() const { return static_cast<int>(of(0).size()); }
  /// Workers of the arena, in their order; empty where the host has none. Host 0 has the free ones.
  std::vector<int> of(uint64_t peer_id) const;
  /// Gives it so many, which are free. Its trajectories are counted anew.
  std::vector<int> take(uint64_t peer_id, int count);
  void free(uint64_t peer_id);
  /// The rollout index in this arena of rollout `theirs` of the host that plays `env`. It counts on across hosts, with one
  /// number left out between two hosts, so that no host's trajectory is taken for a continuation of another's.
  uint64_t rollout_of(int env, uint64_t theirs);
  /// How many rollouts lie between the last one sealed and this one of this arena; less than 0: it was sealed before.
  int64_t ahead(int env, uint64_t rollout_index) const;
  /// Seals a slab of this arena as a simulator seals its own. Returns its agent decisions.
  uint64_t seal(int env, uint32_t slab_index, const RemoteRollout& rollout);
  /// Agent decisions sealed for it since it got its places, to the last one.
  uint64_t sealed_for(uint64_t peer_id) const;

 private:
  const shm::Arena& arena_;
  const int first_worker_, worker_count_;
};

}  // namespace comrad::link
