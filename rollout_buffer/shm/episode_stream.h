// Finished episodes: one stream that several readers follow, each at its own pace.
//
//   EpisodeHead [sim worker] | EpisodeCursor [reader, sim worker] | EpisodeCell [sim worker, capacity]
//
// Writers: each simulator (of another host the receiver) in its own cells, each reader in its own cursors. No writer waits
// for a reader, and no reader makes another lose: one that falls behind misses the oldest episodes and counts them.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/arena_shape.h"

namespace comrad::shm {

struct Region;

/// Each is one process at a time; its successor resumes where it was. On a host without a learner its place is the sender's.
enum class EpisodeReader : uint32_t { kSupervisor, kLearner, kCurriculum };
constexpr int kEpisodeReaderCount = 3;

/// Episode number n of a simulator lies in cell n % capacity.
struct alignas(kCacheLineBytes) EpisodeCell {
  std::atomic<uint64_t> sequence;  ///< 2n + 1 while episode n is being written, then 2n + 2; 0: none yet
  EpisodeRecord record;
};
static_assert(sizeof(EpisodeCell) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

struct alignas(kCacheLineBytes) EpisodeHead {
  std::atomic<uint64_t>
      written;  ///< episodes of the simulator; a simulator killed half way has not counted its last one
};
static_assert(sizeof(EpisodeHead) == kCacheLineBytes, "changing this bumps kArenaVersion");

struct alignas(kCacheLineBytes) EpisodeCursor {
  std::atomic<uint64_t> read;  ///< episodes of the simulator that the reader is done with
  std::atomic<uint64_t> lost;  ///< of them: overwritten before it came
};
static_assert(sizeof(EpisodeCursor) == kCacheLineBytes, "changing this bumps kArenaVersion");

class EpisodeStream {
 public:
  EpisodeStream(const ArenaShape& shape, Region& region);

  void write(const EpisodeRecord& record) const;  ///< by record.env_index
  /// The oldest episode that the reader has not read, simulator by simulator.
  std::optional<EpisodeRecord> read(EpisodeReader reader) const;
  uint64_t lost(EpisodeReader reader) const;
  int64_t capacity() const { return capacity_; }  ///< episodes of one simulator

 private:
  EpisodeCursor& cursor(EpisodeReader reader, int sim_worker) const;
  EpisodeCell& cell(int sim_worker, uint64_t number) const;
  std::optional<EpisodeRecord> read(EpisodeReader reader, int sim_worker) const;

  const ArenaShape shape_;
  const int64_t capacity_;
  EpisodeHead* const heads_;
  EpisodeCursor* const cursors_;
  EpisodeCell* const cells_;
};

}  // namespace comrad::shm
