// Finished episodes on their way: from each simulator to the supervisor, and from the supervisor to the learner.
//
//   EpisodeRing [sim worker + 1] | EpisodeRecord [sim worker + 1, capacity]
//
// Writers: each simulator in its own ring, the supervisor in the last one.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::shm {

struct Region;

/// One finished episode, as the supervisor publishes it (topic EpisodeResult).
struct EpisodeRecord {
  uint64_t episode_id;
  uint64_t episode_seed;
  uint64_t layout_id;
  uint32_t env_index;
  uint32_t length_steps;  ///< decisions
  uint32_t length_tics;
  uint32_t terminated;             ///< 1 terminated, 0 truncated
  float score;                     ///< J, team level
  float ceiling;                   ///< the best J that the map allows so many agents; 0: not known
  float agent_return[kMaxAgents];  ///< sum of rewards before scale, clip and sharing
  float agent_score[kMaxAgents];   ///< J per agent, where the scenario tells them apart; else J
};
static_assert(sizeof(EpisodeRecord) == 48 + 8 * kMaxAgents, "changing this bumps kArenaVersion");

/// `written` and `read` count up for ever, cells are taken modulo the capacity.
struct EpisodeRing {
  alignas(kCacheLineBytes) std::atomic<uint64_t> written;  ///< simulator; of the last ring the supervisor
  std::atomic<uint64_t> dropped;                           ///< the same
  alignas(kCacheLineBytes) std::atomic<uint64_t> read;     ///< supervisor; of the last ring the learner
};
static_assert(sizeof(EpisodeRing) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// A simulator killed half way leaves a record that was never announced. A full ring drops the newest and counts it.
class EpisodeStream {
 public:
  EpisodeStream(const ArenaShape& shape, Region& region);

  bool push(const EpisodeRecord& record) const;  ///< simulator; record.env_index tells which
  std::optional<EpisodeRecord> pop() const;      ///< supervisor
  uint64_t dropped() const;
  bool forward(const EpisodeRecord& record) const;     ///< supervisor
  std::optional<EpisodeRecord> pop_forwarded() const;  ///< learner

 private:
  bool push_to(int64_t ring_index, const EpisodeRecord& record) const;
  std::optional<EpisodeRecord> pop_from(int64_t ring_index) const;

  const ArenaShape shape_;
  const int64_t capacity_;
  EpisodeRing* const rings_;
  EpisodeRecord* const cells_;
};

}  // namespace comrad::shm
